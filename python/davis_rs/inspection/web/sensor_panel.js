// Events of a window of time over the last picture of a layer: intensity frames, or maps of the ground truth.

const layers = data.layers.map((layer) => ({ ...layer, images: layer.png.map(() => new Image()) }));
const layersLoaded = Promise.all(layers.flatMap((layer) => layer.images.map((image, i) => new Promise((loaded, failed) => {
  image.onload = loaded;
  image.onerror = () => failed(new Error(`${layer.name} ${i} is no image`));
  image.src = `data:image/png;base64,${layer.png[i]}`;
}))));

/** The number of the last picture of a layer until `t`, -1 before the first or without a layer. */
const pictureAt = (layer, t) => layer ? countUntil(layer.t, t) - 1 : -1;

const sensorPanel = (() => {
  const { width, height } = data;
  const canvas = element("sensor");
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext("2d");
  const picture = context.createImageData(width, height), pixels = new Uint32Array(picture.data.buffer);
  const background = new Uint32Array(width * height);
  const word = (r, g, b) => (255 << 24 | b << 16 | g << 8 | r) >>> 0;
  const colours = [word(...OFF), word(...ON)];
  let shown = null, rgba = null;

  // Where the screen shows fewer pixels than the sensor has, an event covers as many as make one of the screen's: otherwise most would
  // fall between them.
  const blockSide = () => Math.max(1, Math.ceil(width / ((canvas.clientWidth || width) * (window.devicePixelRatio || 1)) - 0.01));
  const fillBlock = (x, y, side, colour) => {
    const right = Math.min(width, x + side), bottom = Math.min(height, y + side);
    for (let row = y; row < bottom; row++) {
      for (let column = x; column < right; column++) pixels[row * width + column] = colour;
    }
  };

  // A picture is faded, so that events stand out; without events it is shown as it is.
  const fill = (layer, index, faded) => {
    const key = `${layer && layer.name} ${index} ${faded}`;
    if (key === shown) return;
    shown = key;
    rgba = null;
    if (index < 0) { background.fill(0xffffffff); return; }
    context.drawImage(layer.images[index], 0, 0, width, height);
    rgba = context.getImageData(0, 0, width, height).data;
    const level = (value) => faded ? Math.round(115 + 0.55 * value) : value;
    for (let i = 0; i < background.length; i++) {
      background[i] = word(level(rgba[4 * i]), level(rgba[4 * i + 1]), level(rgba[4 * i + 2]));
    }
  };

  // Of shapes, the name of the one at which the pointer is: its colour, before it is faded, tells which.
  const label = element("shape-name");
  let names = {}, pointer = null;
  const showName = () => {
    label.hidden = true;
    if (!pointer || !rgba) return;
    const column = Math.min(width - 1, Math.floor(pointer.x / canvas.clientWidth * width));
    const row = Math.min(height - 1, Math.floor(pointer.y / canvas.clientHeight * height));
    const at = 4 * (row * width + column);
    const name = names[(rgba[at] << 16 | rgba[at + 1] << 8 | rgba[at + 2]).toString(16).padStart(6, "0")];
    if (!name) return;
    label.textContent = name;
    label.style.left = `${pointer.x}px`;
    label.style.top = `${pointer.y}px`;
    label.classList.toggle("leftwards", pointer.x > canvas.clientWidth / 2);
    label.hidden = false;
  };
  const point = (event) => {
    pointer = { x: Math.max(0, event.offsetX), y: Math.max(0, event.offsetY) };
    showName();
  };
  canvas.addEventListener("pointermove", point);
  canvas.addEventListener("pointerdown", point);
  canvas.addEventListener("pointerleave", () => { pointer = null; showName(); });

  return (t, window_us, show) => {
    const index = pictureAt(show.layer, t);
    fill(show.layer, index, show.on || show.off);
    names = show.layer ? show.layer.names : {};
    showName();
    pixels.set(background);
    const first = countUntil(events.t, t - window_us), total = countUntil(events.t, t) - first;
    const side = blockSide();
    return {
      total,
      put: (from, to, step) => {
        for (let k = from; k < to; k = nextDrawn(k, step)) {
          const i = first + k;
          if (events.on[i] ? !show.on : !show.off) continue;
          if (side > 1) fillBlock(events.xy[2 * i], events.xy[2 * i + 1], side, colours[events.on[i]]);
          else pixels[events.xy[2 * i + 1] * width + events.xy[2 * i]] = colours[events.on[i]];
        }
      },
      show: (step) => {
        context.putImageData(picture, 0, 0);
        const says = [eventsText(countShown(first, first + total, show), step, t, window_us)];
        if (show.layer) {
          const { name, t: times } = show.layer;
          const when = index < 0 ? `no ${name} yet` : `${name} of ${((times[index] + data.start_us) / 1e6).toFixed(4)} s`;
          says.push(show.layer.says ? `${when}: ${show.layer.says}` : when);
        }
        element("sensor-says").textContent = says.join("; ");
      },
    };
  };
})();
