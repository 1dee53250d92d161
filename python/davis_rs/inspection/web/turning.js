// A view of three dimensions that turns with the mouse: parallel projection, so that a picture in space stays a
// parallelogram, which a canvas can draw.

const turning = (canvas, start, changed) => {
  const view = { ...start };
  let from = null;
  canvas.addEventListener("pointerdown", (event) => {
    from = [event.clientX, event.clientY];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!from) return;
    view.yaw -= 0.008 * (event.clientX - from[0]);
    view.pitch = Math.max(-1.57, Math.min(1.57, view.pitch + 0.008 * (event.clientY - from[1])));
    from = [event.clientX, event.clientY];
    changed();
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { from = null; });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    view.zoom = Math.max(0.2, Math.min(40, view.zoom * Math.exp(-0.0015 * event.deltaY)));
    changed();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => { Object.assign(view, start); changed(); });
  return view;
};

/** Coefficients of the projection: right = [x, y, z], down and away likewise, for axes x right, y down, z away. */
const projection = (view) => {
  const cy = Math.cos(view.yaw), sy = Math.sin(view.yaw), cp = Math.cos(view.pitch), sp = Math.sin(view.pitch);
  return { right: [cy, 0, sy], down: [sy * sp, cp, -cy * sp], away: [-sy * cp, sp, cy * cp] };
};

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
