"use strict";
// The page of `live`. What the server sends: about, status, path, map, closures, times, scan.
const state = { path: [], map: null, closures: [], wheels: [], scan: null, times: [], isOver: false, newest: -1, isPaused: false, n: 0,
  // the newest scan, and whether an earlier one is looked at
  now: null, isBack: false };
let mayAct = false;

function listen() {
  const events = new EventSource("events");
  const on = (name, take) => events.addEventListener(name, (e) => { take(JSON.parse(e.data)); redraw(); });
  on("about", (a) => {
    $("name").textContent = a.name; $("mode").textContent = a.mode; document.title = `${a.name} – curvescan live`;
    document.body.classList.toggle("slam", a.mode === "SLAM");
    state.path = []; state.closures = []; state.wheels = []; state.n = a.n_scans || 0;
    state.isBack = false;
    offer(a.replay);
    if (a.replay) showPace(a.pace);
  });
  on("status", showStatus);
  on("path", (p) => { state.path.length = 2 * p.start; for (const v of p.points) state.path.push(v); });
  on("wheels", (w) => { state.wheels.length = 2 * w.start; for (const v of w.points) state.wheels.push(v); $("by-wheels").hidden = false; });
  on("map", loadMap);
  on("closures", (c) => { state.closures = c.lines; });
  on("times", (t) => { state.times = t.ms; });
  on("scan", (s) => {
    state.now = s; state.times.push(s.ms);
    if (state.times.length > 120) state.times.shift();
    if (!state.isBack) { state.scan = s; showFigures(s); }
  });
  events.onerror = () => { if (!state.isOver) showMessage("The connection is lost; trying again."); else events.close(); };
  events.onopen = () => { if (!state.isOver) showMessage(""); };
}

function showStatus(s) {
  state.isOver = s.kind === "ended" || s.kind === "error";
  if (state.isOver) showDock(false);
  if (s.kind === "loading") chip("outcome", "waiting", s.text);
  showMessage(s.kind === "loading" || s.text === "running" ? "" : s.text);
}

function loadMap(map) {
  // two pictures at once would come in any order: the newest wins
  state.newest = map.version;
  const image = new Image();
  image.onload = () => { if (map.version === state.newest) { state.map = { ...map, image }; redraw(); } };
  image.src = "map.png?" + map.version;
}

function showFigures(s) {
  showPose(s.pose, s.covariance);
  $("ms").textContent = `${s.ms_median.toFixed(1)}, max ${s.ms_max.toFixed(0)}`;
  $("scans").textContent = (s.index + 1).toLocaleString("en");
  $("rate").textContent = s.rate === null ? "–" : `${s.rate.toFixed(1)} Hz`;
  $("length").textContent = `${s.length.toFixed(1)} m`;
  $("score").textContent = s.score === null ? "–" : s.score.toFixed(2);
  for (const name of ["n_closures", "n_lost", "n_dropped"]) $(name).textContent = s[name].toLocaleString("en");
  chip("outcome", s.tone, s.word, s.sentence + (s.degenerate ? " One direction is unobservable." : ""));
  if (document.activeElement !== $("time")) $("time").value = s.index;
  $("clock").textContent = `${(s.index + 1).toLocaleString("en")} / ${state.n ? state.n.toLocaleString("en") : "…"}`;
  spark();
}

// Scans to come are tracked as fast as they go; what was tracked is shown as it was then, and the replay waits.
async function seek(to) {
  if (!state.now || to > state.now.index) { lookBack(null); return pace({ to }); }
  await pace({ is_paused: true });
  lookBack(await (await post("earlier", { to })).json());
}
function lookBack(frame) {
  state.isBack = frame !== null;
  state.scan = frame || state.now;
  if (state.scan) showFigures(state.scan);
  showMessage(frame ? `Scan ${(frame.index + 1).toLocaleString("en")} as it was tracked. ▶ goes on with the newest.` : "");
  redraw();
}

async function offer(isReplay) {
  // others may look on, and change nothing: only a page of this machine is given the token
  const answer = await fetch("token").catch(() => null);
  if (!answer || !answer.ok) return;
  setToken(await answer.text());
  $("save").hidden = false;
  if (!isReplay || state.isOver) return;
  $("time").max = Math.max(state.n - 1, 0); $("time").hidden = !state.n; $("time").value = state.scan ? state.scan.index : 0;
  showDock(true);
  if (mayAct) return;
  mayAct = true;
  $("play").addEventListener("click", () => { if (state.isBack) lookBack(null); pace({ is_paused: !state.isPaused }); });
  $("time").addEventListener("change", (e) => seek(Number(e.target.value)));
  $("speed").addEventListener("change", (e) => pace({ speed: Number(e.target.value) }));
}
function showDock(isShown) { $("dock").hidden = !isShown; document.body.classList.toggle("docked", isShown); redraw(); }
async function pace(wanted) { showPace(await (await post("pace", wanted)).json()); }
function showPace({ speed, is_paused: isPaused }) {
  state.isPaused = isPaused;
  $("play").textContent = isPaused ? "▶" : "❚❚"; $("play").setAttribute("aria-label", isPaused ? "Go on" : "Pause");
  const options = [...$("speed").options], known = options.find((o) => Number(o.value) === speed);
  if (!known) $("speed").add(new Option(`×${speed}`, speed));
  $("speed").value = String(speed);
}
$("save").addEventListener("click", () => download("save", {}, "map.csmap").catch(() => {}));

function spark() {
  const c = $("spark"), ratio = devicePixelRatio || 1, w = c.clientWidth, h = c.clientHeight;
  c.width = w * ratio; c.height = h * ratio;
  const p = c.getContext("2d");
  p.scale(ratio, ratio);
  const top = 1.15 * Math.max(...state.times), step = w / 120;
  p.fillStyle = colours.path; p.globalAlpha = 0.8;
  state.times.forEach((t, i) => { const bar = Math.max(1, (h * t) / top); p.fillRect(i * step, h - bar, Math.max(step - 1, 1), bar); });
}

stage.target = () => (state.scan && state.scan.pose ? state.scan.pose : null);
stage.places = (take) => {
  if (state.map) {
    const { origin: [x, y], resolution: r, shape: [rows, columns] } = state.map;
    take(x, y); take(x + r * columns, y + r * rows);
  }
  for (let i = 0; i < state.path.length; i += 2) take(state.path[i], state.path[i + 1]);
};
stage.draw = () => {
  const s = state.scan, isPlaced = stage.target() !== null;
  drawMap(state.map); drawLinks(state.closures, colours.closure);
  drawPath(state.wheels, 2, colours.wheels, { width: 1.5, dash: [6, 4] });
  drawPath(state.path, 2, colours.path, { last: state.now && state.now.pose });
  if (isPlaced) { drawScan(s.pose, s.points, 1e-3); drawRobot(s.pose, s.covariance, true); }
};
readColours(); choose(true, false); listen();
