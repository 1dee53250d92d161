// Events in space and time, (x, y, t), up to the instant that is shown, with the picture behind the events at that instant.
// Points are put into an array of pixels: a hundred thousand take some milliseconds, without WebGL.

const DEPTH = 1.7;  // length of the time axis where the longer side of the sensor has 1

const cloudStart = { yaw: 0.95, pitch: 0.38, zoom: 1 };
const LABELS = 22;  // pixels of the screen that labels need below the box, and as many above it

const cloudPanel = (canvas, view, t, length_us, show) => {
  const { width: columns, height: rows } = data, side = Math.max(columns, rows);
  const { right, down, away } = projection(view);
  const first = countUntil(events.t, t - length_us), last = countUntil(events.t, t), total = last - first;
  const half = [columns / side / 2, rows / side / 2, DEPTH / 2], pictureIsFar = away[2] > 0;
  const { width, height, ratio } = sharpSize(canvas, 0.75 * canvas.clientWidth);
  // At the start the whole box is in view, also of a sensor that is as high as it is wide.
  const high = 2 * projection(cloudStart).down.reduce((sum, part, i) => sum + Math.abs(part) * half[i], 0);
  const scale = Math.min(0.5 * width, 0.6 * height, (height - 2 * LABELS) / high) * view.zoom;

  const w = canvas.width, h = canvas.height;
  const points = cloudPanel.points ||= document.createElement("canvas");
  if (points.width !== w || points.height !== h || !cloudPanel.layer) {
    points.width = w;
    points.height = h;
    cloudPanel.layer = new ImageData(w, h);
  }
  const { layer } = cloudPanel, pixels = new Uint32Array(layer.data.buffer);
  pixels.fill(0);
  const words = [OFF, ON].map(([r, g, b]) => (255 << 24 | b << 16 | g << 8 | r) >>> 0);
  const s = scale * ratio, perPixel = s / side, perUs = s * DEPTH / length_us;
  const x0 = w / 2 - s * (right[0] * half[0] + right[1] * half[1]) + s * right[2] * half[2];
  const y0 = h / 2 - s * (down[0] * half[0] + down[1] * half[1]) + s * down[2] * half[2];
  const size = Math.max(1, Math.round(ratio * (total > 60000 ? 1 : 2) * Math.min(2, Math.sqrt(view.zoom))));
  const put = (from, to, step) => {
    for (let k = from; k < to; k = nextDrawn(k, step)) {
      const i = pictureIsFar ? last - 1 - k : first + k;  // what is far first
      const on = events.on[i];
      if (on ? !show.on : !show.off) continue;
      const x = events.xy[2 * i] * perPixel, y = events.xy[2 * i + 1] * perPixel, z = (events.t[i] - t) * perUs;
      const column = Math.round(x0 + right[0] * x + right[1] * y + right[2] * z);
      const row = Math.round(y0 + down[0] * x + down[1] * y + down[2] * z);
      for (let r = row; r < row + size; r++) {
        if (r < 0 || r >= h) continue;
        for (let c = column; c < column + size; c++) if (c >= 0 && c < w) pixels[r * w + c] = words[on];
      }
    }
  };

  const place = (p) => [width / 2 + scale * dot(right, p), height / 2 + scale * dot(down, p)];
  const drawBox = (context) => {
    context.strokeStyle = "#c3cad0";
    const line = (from, to) => {
      context.beginPath();
      context.moveTo(...place(from));
      context.lineTo(...place(to));
      context.stroke();
    };
    for (const [a, b, c] of [[0, 1, 2], [1, 0, 2], [2, 0, 1]]) {
      for (const [s, u] of [[-1, -1], [-1, 1], [1, -1], [1, 1]]) {
        const from = [0, 0, 0];
        from[a] = -half[a]; from[b] = s * half[b]; from[c] = u * half[c];
        const to = [...from];
        to[a] = half[a];
        line(from, to);
      }
    }
  };
  const drawPicture = (context, alpha) => {
    const index = pictureAt(show.layer, t);
    if (index < 0) return;
    const [x, y] = place([-half[0], -half[1], half[2]]), unit = scale / side;
    context.save();
    context.globalAlpha = alpha;
    context.imageSmoothingEnabled = false;
    context.transform(unit * right[0], unit * down[0], unit * right[1], unit * down[1], x, y);
    context.drawImage(show.layer.images[index], 0, 0, columns, rows);
    context.restore();
  };
  const drawLabels = (context) => {
    context.fillStyle = "#5c6670";
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "center";
    const label = (text, at, dx, dy) => { const [x, y] = place(at); context.fillText(text, x + dx, y + dy); };
    label("x", [0, half[1], -half[2]], 0, 16);
    label("y", [-half[0], 0, -half[2]], -12, 4);
    label(`${((t - length_us + data.start_us) / 1e6).toFixed(3)} s`, [half[0], half[1], -half[2]], 0, 16);
    label(`${((t + data.start_us) / 1e6).toFixed(3)} s`, [half[0], half[1], half[2]], 0, 16);
  };
  return {
    total,
    put,
    show: (step) => {
      const { context } = sharp(canvas, height);
      drawBox(context);
      if (pictureIsFar) drawPicture(context, 1);
      points.getContext("2d").putImageData(layer, 0, 0);
      context.drawImage(points, 0, 0, width, height);
      if (!pictureIsFar) drawPicture(context, 0.6);
      drawLabels(context);
      element("cloud-says").textContent = eventsText(countShown(first, last, show), step, t, length_us, " in space and time");
    },
  };
};
