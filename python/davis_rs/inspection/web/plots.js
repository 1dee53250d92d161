// Curves over time with a cursor; a click or a drag in one goes to that time.

const PLOT_COLOURS = ["#d55e00", "#009e73", "#0072b2"];  // told apart with the usual kinds of colour blindness
const LEFT = 52, RIGHT = 8, TOP = 6, BOTTOM = 20;

/** Round numbers from `low` to `high`, about `count` of them. */
const ticks = (low, high, count) => {
  const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * power).find((one) => one >= raw);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return { found, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
};

/** A plot of curves [{name, colour, t, values}], t in microseconds; `steps`: values hold until the next time. */
const makePlot = (id, curves, { steps = false, fromZero = false, seek }) => {
  const canvas = element(id), start = data.start_us / 1e6, end = (data.start_us + data.duration_us) / 1e6;
  let low = fromZero ? 0 : Infinity, high = fromZero ? 0 : -Infinity;
  for (const { values } of curves) for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
  if (!(high > low)) { low = Number.isFinite(low) ? low - 1 : 0; high = low + 2; }
  const margin = 0.06 * (high - low);
  high += margin;
  if (!fromZero) low -= margin;
  for (const { name, colour } of curves) {
    const label = document.createElement("span");
    label.textContent = `\u2014 ${name}`;
    label.style.color = colour;
    element(`${id}-legend`).append(label);
  }
  const at = (event) => (event.offsetX - LEFT) / (canvas.clientWidth - LEFT - RIGHT) * data.duration_us;
  canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); seek(at(event)); });
  canvas.addEventListener("pointermove", (event) => { if (event.buttons) seek(at(event)); });

  const still = document.createElement("canvas");  // all but the cursor
  const drawStill = (width, height, ratio) => {
    still.width = Math.round(width * ratio);
    still.height = Math.round(height * ratio);
    const context = still.getContext("2d");
    context.scale(ratio, ratio);
    const x = (us) => LEFT + us / data.duration_us * (width - LEFT - RIGHT);
    const y = (value) => TOP + (high - value) / (high - low) * (height - TOP - BOTTOM);
    context.font = "11px system-ui, sans-serif";
    context.fillStyle = "#5c6670";
    context.strokeStyle = "#e8ecef";
    context.textAlign = "right";
    const rows = ticks(low, high, 4), columns = ticks(start, end, Math.max(2, Math.floor(width / 110)));
    for (const value of rows.found) {
      context.beginPath();
      context.moveTo(LEFT, y(value));
      context.lineTo(width - RIGHT, y(value));
      context.stroke();
      context.fillText(value.toFixed(rows.digits), LEFT - 6, y(value) + 4);
    }
    context.textAlign = "center";
    for (const value of columns.found) {
      const last = value === columns.found[columns.found.length - 1];
      const where = x(1e6 * value - data.start_us);
      context.fillText(`${value.toFixed(columns.digits)}${last ? " s" : ""}`, Math.min(where, width - 22), height - 5);
    }
    context.lineWidth = 1.2;
    context.lineJoin = "round";
    for (const { t, values, colour } of curves) {
      context.beginPath();
      for (let i = 0; i < values.length; i++) {
        if (i === 0) context.moveTo(x(t[0]), y(values[0]));
        else { if (steps) context.lineTo(x(t[i]), y(values[i - 1])); context.lineTo(x(t[i]), y(values[i])); }
      }
      if (steps && values.length) context.lineTo(x(data.duration_us), y(values[values.length - 1]));
      context.strokeStyle = colour;
      context.stroke();
    }
  };

  let drawnFor = "";
  return (t) => {
    const { context, width, height, ratio } = sharp(canvas, canvas.clientHeight);
    const key = `${width} ${height} ${ratio}`;
    if (key !== drawnFor && width > LEFT + RIGHT) { drawStill(width, height, ratio); drawnFor = key; }
    context.drawImage(still, 0, 0, width, height);
    const x = LEFT + t / data.duration_us * (width - LEFT - RIGHT);
    context.fillStyle = "#1c2126";
    context.fillRect(x - 0.5, TOP, 1, height - TOP - BOTTOM);
  };
};
