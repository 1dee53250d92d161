// The data of the page: base64 of typed arrays (little-endian) becomes arrays, times count from the sequence's start.

const element = (id) => document.getElementById(id);

const problem = (text) => {
  element("problem").textContent = text;
  element("problem").hidden = false;
};
window.addEventListener("error", (event) => problem(`This page met an error: ${event.message}`));

const bytesOf = (text) => Uint8Array.from(atob(text), (character) => character.charCodeAt(0)).buffer;

const data = JSON.parse(element("data").textContent);

const events = (() => {
  const packed = new Uint32Array(bytesOf(data.events.t));
  const t = new Float64Array(packed.length), on = new Uint8Array(packed.length);
  for (let i = 0; i < packed.length; i++) {
    t[i] = (packed[i] >>> 1) * data.events.tick_us;
    on[i] = packed[i] & 1;
  }
  const word = packed.length < data.events.total ? "sampled events" : "events";
  return { count: packed.length, word, t, on, xy: new Uint16Array(bytesOf(data.events.xy)) };
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

const ON = [202, 0, 32], OFF = [5, 113, 176];  // as in the figures of davis-rs view
const number = (value) => value.toLocaleString("en-US");

/** A time in microseconds as text of the unit that suits it. */
const lengthText = (us) => {
  if (us < 1000) return `${us.toPrecision(3)} \u00b5s`;
  return us < 1e6 ? `${(us / 1e3).toPrecision(3)} ms` : `${(us / 1e6).toPrecision(3)} s`;
};

/** A canvas whose pixels are those of the screen; draws in CSS pixels. Returns the context and the size in CSS pixels. */
const sharp = (canvas, height) => {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth;
  const columns = Math.max(1, Math.round(width * ratio)), rows = Math.max(1, Math.round(height * ratio));
  if (canvas.width !== columns || canvas.height !== rows) { canvas.width = columns; canvas.height = rows; }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height, ratio };
};
