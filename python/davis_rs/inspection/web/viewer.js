// Time, the controls, and what is drawn when one of them changes.

const state = { t: data.t_us, playing: false, speed: data.speed, window: data.window_us, length: 0, dirty: false };
// The cloud is longer than the window, and has some thousands of events where there are as many.
state.length = Math.min(data.duration_us, Math.max(5 * state.window, 5000 / Math.max(1, events.count) * data.duration_us));

const fromAddress = () => {
  const asked = new URLSearchParams(window.location.hash.slice(1)), t = Number(asked.get("t"));
  if (asked.has("t") && Number.isFinite(t)) seek(1e6 * t - data.start_us);
  const number = layers.findIndex((layer) => layer.name === asked.get("behind"));
  if (number >= 0) element("behind").value = number;
  redraw();
};
const redraw = () => { state.dirty = true; };
const seek = (t) => {
  state.t = Math.max(0, Math.min(data.duration_us, t));
  redraw();
};
const play = (playing) => {
  if (playing && state.t >= data.duration_us) seek(0);
  state.playing = playing;
  element("play").textContent = playing ? "\u275a\u275a" : "\u25b6";
  element("play").setAttribute("aria-label", playing ? "stop" : "play");
};

// Lengths have sliders of their logarithm, from a ten-thousandth of the sequence to all of it.
const bindLength = (id, key) => {
  const slider = element(id), least = Math.min(Math.max(10, data.duration_us / 1e4), data.duration_us / 2);
  const range = Math.log(data.duration_us / least);
  slider.value = Math.log(Math.max(least, state[key]) / least) / range;
  const says = () => { element(`${id}-says`).textContent = lengthText(state[key]); };
  slider.addEventListener("input", () => {
    state[key] = least * Math.exp(range * Number(slider.value));
    says();
    redraw();
  });
  says();
};
bindLength("window", "window");
bindLength("length", "length");

for (const speed of data.speeds) {
  const option = document.createElement("option");
  option.value = speed;
  option.textContent = speed === 1 ? "real time" : `${speed} \u00d7`;
  element("speed").append(option);
}
element("speed").value = data.speed;
element("speed").addEventListener("change", (event) => { state.speed = Number(event.target.value); });
element("play").addEventListener("click", () => play(!state.playing));
element("time").addEventListener("input", (event) => seek(Number(event.target.value) * data.duration_us));
for (const id of ["behind", "show-on", "show-off"]) element(id).addEventListener("change", redraw);
for (const [i, name] of [...layers.map((layer) => layer.name), "nothing"].entries()) {
  const option = document.createElement("option");
  option.value = i;
  option.textContent = name;
  element("behind").append(option);
}
window.addEventListener("resize", redraw);
window.addEventListener("hashchange", fromAddress);
window.addEventListener("keydown", (event) => {
  if (["INPUT", "SELECT", "BUTTON"].includes(event.target.tagName)) return;
  if (event.key === " ") play(!state.playing);
  else if (event.key === "ArrowLeft") seek(state.t - state.window);
  else if (event.key === "ArrowRight") seek(state.t + state.window);
  else return;
  event.preventDefault();
});

const cloudView = turning(element("cloud"), cloudStart, redraw);
const pathView = pathScene && turning(element("path"), pathScene.start, redraw);

const plots = (() => {
  const on = new Uint32Array(bytesOf(data.rate.on)), off = new Uint32Array(bytesOf(data.rate.off));
  const times = Float64Array.from(on, (_, i) => i * data.rate.bin_us);
  const most = Math.max(1, on.reduce((a, b) => Math.max(a, b), 0), off.reduce((a, b) => Math.max(a, b), 0)) * 1e6 / data.rate.bin_us;
  const [unit, name] = most >= 1e6 ? [1e6, "Mev/s"] : most >= 1e3 ? [1e3, "kev/s"] : [1, "ev/s"];
  const rate = (counts) => Float64Array.from(counts, (count) => count * 1e6 / data.rate.bin_us / unit);
  const colour = ([r, g, b]) => `rgb(${r}, ${g}, ${b})`;
  const made = [makePlot("rate", [
    { name: `ON (${name})`, colour: colour(ON), t: times, values: rate(on) },
    { name: `OFF (${name})`, colour: colour(OFF), t: times, values: rate(off) },
  ], { steps: true, fromZero: true, seek })];
  if (imu && imu.t.length) {
    const axis = (k) => Float64Array.from(imu.t, (_, i) => imu.values[6 * i + k]);
    for (const [id, first] of [["accel", 0], ["gyro", 3]]) {
      made.push(makePlot(id, ["x", "y", "z"].map((name, k) => (
        { name, colour: PLOT_COLOURS[k], t: imu.t, values: axis(first + k) })), { seek }));
    }
  }
  return made;
})();
const hasImu = Boolean(imu && imu.t.length);
element("imu").hidden = !hasImu;
element("path-figure").hidden = !pathScene;
element("motion").hidden = !hasImu && !pathScene;
element("motion").classList.toggle("single", !hasImu || !pathScene);

element("notes").textContent = [
  events.count === data.events.total ? "All events are shown."
    : data.events.span_us
      ? `Events shown are all ${number(events.count)} ${spanText()}, of ${number(data.events.total)}; the event rate counts all of them.`
      : `Events shown are ${number(events.count)} drawn evenly from ${number(data.events.total)}; the event rate counts all of them.`,
  ...layers.filter((layer) => layer.t.length < layer.total)
    .map((layer) => `${layer.t.length} of ${number(layer.total)} ${layer.maps} are shown, evenly spaced.`),
].join(" ");

// Panels of which only some events are drawn so far, and the one that is being drawn whole, with how many events it has.
let rest = [], whole = null;
const unfinished = () => whole || rest.length;

/** Draw a part of what was left out. Whatever changes then, it begins with some of the events again. */
const drawRest = () => {
  whole ||= { panel: rest.shift()(), done: 0 };
  const { panel, done } = whole, until = Math.min(panel.total, done + A_PART);
  panel.put(done, until, 1);
  whole.done = until;
  if (until < panel.total) return;
  panel.show(1);
  whole = null;
};

const draw = () => {
  whole = null;
  const layer = layers[Number(element("behind").value)];
  const show = { layer, on: element("show-on").checked, off: element("show-off").checked };
  const panels = [
    () => sensorPanel(state.t, state.window, show),
    () => cloudPanel(element("cloud"), cloudView, state.t, state.length, show),
  ];
  rest = panels.map((begin) => {
    const panel = begin(), step = Math.ceil(panel.total / AT_ONCE) || 1;
    panel.put(0, panel.total, step);
    panel.show(step);
    return step > 1 ? begin : null;
  }).filter(Boolean);
  if (pathScene) drawPath(element("path"), pathView, state.t);
  for (const plot of plots) plot(state.t);
  element("time").value = state.t / data.duration_us;
  const digits = data.duration_us < 1e5 ? 6 : 4;
  element("clock").textContent = `${((state.t + data.start_us) / 1e6).toFixed(digits)} s of ${((data.duration_us + data.start_us) / 1e6).toFixed(digits)} s`;
};

let before = null;
const tick = (now) => {
  if (state.playing && before !== null) {
    seek(state.t + (now - before) * 1e3 * state.speed);
    if (state.t >= data.duration_us) play(false);
  }
  before = now;
  if (state.dirty) {
    state.dirty = false;
    draw();
  } else {
    const end = performance.now() + 8;
    while (unfinished() && performance.now() < end) drawRest();
  }
  window.requestAnimationFrame(tick);
};

layersLoaded.then(() => {
  fromAddress();
  draw();
  while (unfinished()) drawRest();
  state.dirty = false;
  document.documentElement.dataset.state = "ready";
  window.requestAnimationFrame(tick);
}).catch((error) => {
  console.error(error);
  problem(`The data of this page could not be shown: ${error}`);
});
