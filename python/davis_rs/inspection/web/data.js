// The data of the page: base64 of typed arrays (little-endian) becomes arrays, times count from the sequence's start.

const element = (id) => document.getElementById(id);

const problem = (text) => {
  element("problem").textContent = text;
  element("problem").hidden = false;
};
window.addEventListener("error", (event) => problem(`This page met an error: ${event.message}`));
window.addEventListener("unhandledrejection", (event) => problem(`This page met an error: ${event.reason}`));

const bytesOf = (text) => {
  const characters = atob(text), bytes = new Uint8Array(characters.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = characters.charCodeAt(i);
  return bytes.buffer;
};

/** The bytes that zlib compressed. */
const inflated = async (text) => {
  if (!window.DecompressionStream) throw new Error("it needs a browser of 2023 or later");
  const stream = new Blob([bytesOf(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
};

const data = JSON.parse(element("data").textContent);

const BLOCK = 1024;

/** Times, polarities and pixels of the events, from planes of bytes: html_page.py says how they lie; ON events before each block. */
const events = await (async () => {
  const bytes = await inflated(data.events.packed), count = data.events.kept;
  const t = new Float64Array(count), on = new Uint8Array(count), xy = new Uint16Array(2 * count);
  const onBefore = new Uint32Array(Math.ceil(count / BLOCK) + 1);
  let ticks = 0, sum = 0;
  for (let i = 0; i < count; i++) {
    if (i % BLOCK === 0) onBefore[i / BLOCK] = sum;
    const step = (bytes[i] | bytes[i + count] << 8 | bytes[i + 2 * count] << 16 | bytes[i + 3 * count] << 24) >>> 0;
    ticks += step >>> 1;
    t[i] = ticks * data.events.tick_us;
    sum += on[i] = step & 1;
    xy[2 * i] = bytes[i + 4 * count] | bytes[i + 5 * count] << 8;
    xy[2 * i + 1] = bytes[i + 6 * count] | bytes[i + 7 * count] << 8;
  }
  if (count % BLOCK === 0) onBefore[count / BLOCK] = sum;
  return { count, word: count < data.events.total && !data.events.span_us ? "sampled events" : "events", t, on, xy, onBefore };
})();

const stamped = (part) => part && { t: new Float64Array(bytesOf(part.t)), values: new Float32Array(bytesOf(part.values)) };
const imu = stamped(data.imu), path = stamped(data.path);

/** The number of times that are at most `limit`; times must not decrease. */
const countUntil = (times, limit) => {
  let low = 0, high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= limit) low = middle + 1; else high = middle;
  }
  return low;
};

/** The time of which all events are kept, as text. */
const spanText = () => {
  const [from, to] = data.events.span_us.map((t) => ((t + data.start_us) / 1e6).toFixed(4));
  return `from ${from} s to ${to} s`;
};

/** How many of the events from `first` to before `last` are shown. */
const countShown = (first, last, show) => {
  const onUntil = (index) => {
    const block = Math.floor(index / BLOCK);
    let sum = events.onBefore[block];
    for (let i = block * BLOCK; i < index; i++) sum += events.on[i];
    return sum;
  };
  const on = onUntil(last) - onUntil(first);
  return (show.on ? on : 0) + (show.off ? last - first - on : 0);
};

// A panel is drawn from so many events while something changes, in less than the time of a picture on a screen of 60 Hz. Those that
// are left out are drawn once nothing moves, in parts of some milliseconds.
const AT_ONCE = 40000, A_PART = 80000;
// The events that are drawn at first are runs of neighbours, which lie together in memory.
const RUN = 16;

/** The number of the event that is drawn after number `k`, where one run in `step` is drawn. */
const nextDrawn = (k, step) => k % RUN === RUN - 1 ? k + 1 + RUN * (step - 1) : k + 1;

/** What a panel's text says of the events of some time until `t`, one in `step` of which is drawn. */
const eventsText = (count, step, t, length_us, where = "") => {
  const span = data.events.span_us;
  if (span && (t < span[0] || t - length_us > span[1])) return `no events are kept here, those ${spanText()} are`;
  const some = step > 1 ? ` (1 in ${step} drawn while it moves)` : "";
  return `${number(count)} ${events.word}${some} of the last ${lengthText(length_us)}${where}`;
};

const ON = [202, 0, 32], OFF = [5, 113, 176];  // as in the figures of davis-rs view
const number = (value) => value.toLocaleString("en-US");

/** A time in microseconds as text of the unit that suits it. */
const lengthText = (us) => {
  if (us < 1000) return `${us.toPrecision(3)} \u00b5s`;
  return us < 1e6 ? `${(us / 1e3).toPrecision(3)} ms` : `${(us / 1e6).toPrecision(3)} s`;
};

/** Give a canvas the pixels of the screen. Returns its size in CSS pixels, and how many of its own make one. */
const sharpSize = (canvas, height) => {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth;
  const columns = Math.max(1, Math.round(width * ratio)), rows = Math.max(1, Math.round(height * ratio));
  if (canvas.width !== columns || canvas.height !== rows) { canvas.width = columns; canvas.height = rows; }
  return { width, height, ratio };
};

/** The same, cleared, with a context that draws in CSS pixels. */
const sharp = (canvas, height) => {
  const { width, ratio } = sharpSize(canvas, height);
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height, ratio };
};
