// The camera's path, and where the camera is and looks at the instant that is shown.

/** R_world_camera times a vector, for a quaternion (x, y, z, w). */
const rotated = ([x, y, z, w], v) => {
  const t = [2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])];
  return [v[0] + w * t[0] + y * t[2] - z * t[1], v[1] + w * t[1] + z * t[0] - x * t[2], v[2] + w * t[2] + x * t[1] - y * t[0]];
};

const pathScene = path && path.t.length ? (() => {
  const at = (i, from, to) => Array.from(path.values.subarray(7 * i + from, 7 * i + to));
  const least = [Infinity, Infinity, Infinity], most = [-Infinity, -Infinity, -Infinity], up = [0, 0, 0];
  for (let i = 0; i < path.t.length; i++) {
    const above = rotated(at(i, 3, 7), [0, -1, 0]);
    at(i, 0, 3).forEach((value, k) => {
      least[k] = Math.min(least[k], value);
      most[k] = Math.max(most[k], value);
      up[k] += above[k];
    });
  }
  // The axis of the world that is most nearly up for the camera is drawn upwards.
  const vertical = [0, 1, 2].reduce((best, k) => (Math.abs(up[k]) > Math.abs(up[best]) ? k : best), 0);
  const sign = up[vertical] > 0 ? -1 : 1;
  const axes = { down: vertical, across: (vertical + 1) % 3, ahead: (vertical + 2) % 3 };
  const centre = least.map((value, k) => (value + most[k]) / 2);
  // To axes x right, y down, z away. Two of them change sign where the vertical one does, so that the world is not mirrored.
  const turned = (p) => [sign * p[axes.ahead], sign * p[axes.down], p[axes.across]];
  const points = Array.from(path.t, (_, i) => at(i, 0, 3)), places = points.map((p) => turned(p.map((v, k) => v - centre[k])));
  // Of two views from above at right angles, the one in which the path is wider; and how far it reaches from the middle.
  const reachOf = (yaw, side) => {
    const across = projection({ yaw, pitch: 0.45 })[side];
    return places.reduce((best, p) => Math.max(best, Math.abs(dot(across, p))), 1e-6);
  };
  const yaw = [-0.6, 0.97].reduce((best, one) => (reachOf(one, "right") > reachOf(best, "right") ? one : best));
  const reach = Math.max(reachOf(yaw, "right") / 1.5, reachOf(yaw, "down"));
  return { at, centre, points, reach, turned, start: { yaw, pitch: 0.45, zoom: 1 } };
})() : null;

const poseAt = (t) => {
  const { at } = pathScene, last = path.t.length - 1;
  const i = Math.max(0, Math.min(last, countUntil(path.t, t) - 1)), j = Math.min(last, i + 1);
  const share = j > i ? Math.max(0, Math.min(1, (t - path.t[i]) / (path.t[j] - path.t[i]))) : 0;
  const p = at(i, 0, 3), q = at(i, 3, 7), next = at(j, 3, 7), same = q.reduce((sum, v, k) => sum + v * next[k], 0) < 0 ? -1 : 1;
  const between = (a, b, s) => a.map((value, k) => value + share * (s * b[k] - value));
  const quaternion = between(q, next, same), norm = Math.hypot(...quaternion);
  return { position: between(p, at(j, 0, 3), 1), quaternion: quaternion.map((value) => value / norm), index: i };
};

const drawPath = (canvas, view, t) => {
  const { centre, points, reach, turned } = pathScene;
  const { context, width, height } = sharp(canvas, canvas.clientHeight);
  const { right, down } = projection(view), scale = 0.38 * Math.min(width, height) * view.zoom / reach;
  const place = (p) => {
    const q = turned(p.map((value, k) => value - centre[k]));
    return [width / 2 + scale * dot(right, q), height / 2 + scale * dot(down, q)];
  };
  const strip = (points, colour, thickness) => {
    context.beginPath();
    points.forEach((p, k) => (k ? context.lineTo(...place(p)) : context.moveTo(...place(p))));
    context.strokeStyle = colour;
    context.lineWidth = thickness;
    context.stroke();
  };
  const pose = poseAt(t);
  strip(points, "#c3cad0", 1.5);
  strip([...points.slice(0, pose.index + 1), pose.position], "#1c2126", 2);

  const size = 0.3 * reach, ratio = data.height / data.width;
  const corner = (x, y) => rotated(pose.quaternion, [x * 0.5 * size, y * 0.5 * ratio * size, 0.8 * size])
    .map((value, k) => value + pose.position[k]);
  const corners = [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
  strip([...corners, corners[0]], "#ca0020", 1.5);
  for (const one of corners) strip([pose.position, one], "#ca0020", 1);

  // Axes of the world and a length, at the lower left.
  context.font = "12px system-ui, sans-serif";
  const length = 10 ** Math.floor(Math.log10(reach)), pixels = scale * length;
  ["x", "y", "z"].forEach((name, k) => {
    const unit = turned([0, 1, 2].map((i) => (i === k ? 1 : 0)));
    const x = 42 + 26 * dot(right, unit), y = height - 42 + 26 * dot(down, unit);
    context.strokeStyle = context.fillStyle = PLOT_COLOURS[k];
    context.beginPath();
    context.moveTo(42, height - 42);
    context.lineTo(x, y);
    context.stroke();
    context.fillText(name, x + 3, y + 3);
  });
  context.strokeStyle = context.fillStyle = "#5c6670";
  context.beginPath();
  context.moveTo(width - 16 - pixels, height - 14);
  context.lineTo(width - 16, height - 14);
  context.stroke();
  context.textAlign = "right";
  context.fillText(length >= 1 ? `${length} m` : length >= 0.01 ? `${Math.round(100 * length)} cm` : `${1000 * length} mm`, width - 16, height - 20);
  context.textAlign = "left";
  const [x, y, z] = pose.position.map((value) => value.toFixed(3));
  element("path-says").textContent = `camera path; now at (${x}, ${y}, ${z}) m`;
};
