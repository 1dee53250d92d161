// Events of a window of time over the last intensity frame.

const frames = data.frames.png.map(() => new Image());
const framesLoaded = Promise.all(frames.map((image, i) => new Promise((loaded, failed) => {
  image.onload = loaded;
  image.onerror = () => failed(new Error(`frame ${i} is no image`));
  image.src = `data:image/png;base64,${data.frames.png[i]}`;
})));

/** The number of the last frame until `t`, -1 before the first. */
const frameAt = (t) => countUntil(data.frames.t, t) - 1;

const sensorPanel = (() => {
  const { width, height } = data;
  const canvas = element("sensor");
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext("2d");
  const picture = context.createImageData(width, height), pixels = new Uint32Array(picture.data.buffer);
  const background = new Uint32Array(width * height);
  const word = ([r, g, b]) => (255 << 24 | b << 16 | g << 8 | r) >>> 0;
  const colours = [word(OFF), word(ON)];
  let shown = null;

  // A frame is faded, so that events stand out; without events it is shown as it is.
  const fill = (frame, faded) => {
    const key = `${frame} ${faded}`;
    if (key === shown) return;
    shown = key;
    if (frame < 0) { background.fill(0xffffffff); return; }
    context.drawImage(frames[frame], 0, 0, width, height);
    const grey = context.getImageData(0, 0, width, height).data;
    for (let i = 0; i < background.length; i++) {
      const value = faded ? Math.round(115 + 0.55 * grey[4 * i]) : grey[4 * i];
      background[i] = (255 << 24 | value << 16 | value << 8 | value) >>> 0;
    }
  };

  return (t, window_us, show) => {
    fill(show.frame ? frameAt(t) : -1, show.on || show.off);
    pixels.set(background);
    const first = countUntil(events.t, t - window_us), last = countUntil(events.t, t);
    let count = 0;
    for (let i = first; i < last; i++) {
      if (events.on[i] ? !show.on : !show.off) continue;
      pixels[events.xy[2 * i + 1] * width + events.xy[2 * i]] = colours[events.on[i]];
      count++;
    }
    context.putImageData(picture, 0, 0);
    const frame = frameAt(t);
    const when = frame < 0 ? "no frame yet" : `frame of ${((data.frames.t[frame] + data.start_us) / 1e6).toFixed(4)} s`;
    const says = `${number(count)} ${events.word} of the last ${lengthText(window_us)}`;
    element("sensor-says").textContent = data.frames.t.length ? `${says}; ${when}` : says;
  };
})();
