"use strict";
// The page of finished runs: one or two, from a server (which may let them be mended) or from this file itself.
const TYPES = { Float32Array, Float64Array, Uint8Array, Uint16Array, Int32Array };
const N_TONES = 48;
let mending = null, runs = [], at = 0, chosen = null, playing = 0;
const shown = new Set(["map", "path", "scan"]);

async function unpack(deflated) {
  const stream = new Blob([deflated]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer(), length = new DataView(buffer).getUint32(0, true);
  const text = new TextDecoder().decode(new Uint8Array(buffer, 4, length));
  return JSON.parse(text, (_, v) => (v && v.array ? new TYPES[v.array](buffer, 4 + length + v.at, v.n) : v));
}
async function load() {
  if (!$("data")) return unpack(await (await fetch("data")).arrayBuffer());
  const text = atob($("data").textContent), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return unpack(bytes);
}

async function begin() {
  const tree = await load();
  await Promise.all(tree.runs.map(prepare)); // a page that is resized meanwhile draws nothing yet
  runs = tree.runs; stage.n = runs.length;
  const [run] = runs, names = runs.map((r) => r.name);
  $("name").textContent = names.join(" | "); document.title = `${names.join(" | ")} – curvescan view`;
  $("mode").textContent = runs.map((r) => `${r.mode}, ${r.stamps.length.toLocaleString("en")} scans`).join(" | ");
  showVerdict();
  document.body.classList.toggle("graph", runs.some((r) => r.closures));
  for (const name of ["odometry", "wheels"]) $("with-" + name).hidden = !runs.some((r) => r[name]);
  $("time").max = Math.max(run.stamps.length - 1, 0); $("more").open = innerWidth > 640;
  listKinds(); goTo(run.stamps.length - 1); readColours(); choose(true, false);
  if (tree.can_mend) await beginMending();
  document.body.dataset.ready = "yes";
}

async function prepare(run) {
  if (run.map) run.map.image = await createImageBitmap(new Blob([run.map.png], { type: "image/png" }));
  run.starts = null;
  if (run.ranges) {
    const firsts = [0];
    for (const n of run.n_angles) firsts.push(firsts[firsts.length - 1] + n);
    run.firsts = firsts; run.starts = new Float64Array(run.layout.length + 1);
    run.layout.forEach((l, k) => { run.starts[k + 1] = run.starts[k] + run.n_angles[l]; });
  }
  tone(run);
}

function tone(run) {
  // numbers of colours along the path: by time, and by the logarithm of the 95 % radius
  const n = run.stamps.length, c = run.covariances, largest = new Float32Array(n);
  let low = Infinity, high = 0;
  for (let i = 0; i < n; i++) {
    const xx = c[4 * i], xy = c[4 * i + 1], yy = c[4 * i + 2];
    largest[i] = SIGMAS_95 * Math.sqrt(0.5 * (xx + yy) + Math.hypot(0.5 * (xx - yy), xy));
    if (largest[i] > 1e-4) { low = Math.min(low, largest[i]); high = Math.max(high, largest[i]); }
  }
  run.radius = largest; run.range = [low, high];
}
function toneOf(run, kind, [low, high]) {
  const n = run.stamps.length, width = Math.log(Math.max(high / low, 1.01));
  return Uint8Array.from({ length: n }, (_, i) => {
    const t = kind === "time" ? i / Math.max(n - 1, 1) : Math.log(Math.max(run.radius[i], low) / low) / width;
    return Math.min(Math.floor(N_TONES * (t > 0 ? t : 0)), N_TONES - 1);
  });
}
const STOPS = [[68, 90, 200], [33, 145, 180], [60, 180, 110], [225, 175, 40], [214, 60, 50]];
const TONES = Array.from({ length: N_TONES }, (_, k) => {
  const t = (k / (N_TONES - 1)) * (STOPS.length - 1), i = Math.min(Math.floor(t), STOPS.length - 2), f = t - i;
  return `rgb(${STOPS[i].map((v, c) => Math.round(v + f * (STOPS[i + 1][c] - v))).join(" ")})`;
});

function showVerdict() {
  const verdicts = runs.map((r) => r.verdict).filter(Boolean), bad = verdicts.filter((v) => !v.is_trusted);
  const reasons = bad.flatMap((v) => v.reasons).join("; ");
  if (!verdicts.length) { $("verdict").hidden = true; return; }
  chip("verdict", bad.length ? "bad" : "good", bad.length ? `Not to be trusted: ${reasons}` : "Trusted", reasons);
}

const clock = (s) => `${Math.floor(s / 60)}:${String(Math.floor(s % 60)).padStart(2, "0")}`;
function indexIn(run, k) {
  // the scan of another run at the same share of the way, or at the same number where both have as many
  const n = runs[0].stamps.length, m = run.stamps.length;
  return n === m ? k : Math.min(Math.round((k * (m - 1)) / Math.max(n - 1, 1)), m - 1);
}
const poseOf = (run, k) => { const p = run.poses.subarray(3 * k, 3 * k + 3); return p[0] === p[0] ? p : null; };
function goTo(k) {
  const [run] = runs;
  at = Math.min(Math.max(k, 0), Math.max(run.stamps.length - 1, 0)); $("time").value = at;
  $("clock").textContent = `${(at + 1).toLocaleString("en")} / ${run.stamps.length.toLocaleString("en")}  ${clock(run.stamps[at])}`;
  if (!run.stamps.length) return;
  showPose(poseOf(run, at), run.covariances.subarray(4 * at, 4 * at + 4));
  const [tint, word, sentence] = run.outcomes[run.outcome[at]];
  chip("outcome", tint, `${word}: ${sentence}`, sentence);
  redraw();
}

function pointsOf(run, k) {
  if (!run.starts || k >= run.layout.length) return [];
  const first = run.starts[k], angles = run.firsts[run.layout[k]], n = run.starts[k + 1] - first, out = [];
  for (let i = 0; i < n; i++) {
    const r = run.ranges[first + i], a = run.angles[angles + i];
    if (r) out.push(r * Math.cos(a), r * Math.sin(a));
  }
  return out;
}

stage.target = () => (runs.length && runs[0].stamps.length ? poseOf(runs[0], at) : null);
stage.places = (take) => {
  for (const run of runs) {
    if (run.map) {
      const { origin: [x, y], resolution: r, shape: [rows, columns] } = run.map;
      take(x, y); take(x + r * columns, y + r * rows);
    }
    for (let i = 0; i < run.poses.length; i += 3) if (run.poses[i] === run.poses[i]) take(run.poses[i], run.poses[i + 1]);
  }
};
stage.draw = (k) => {
  const run = runs[k];
  if (!run) return;
  const i = indexIn(run, at), pose = run.stamps.length ? poseOf(run, i) : null;
  const isChosen = chosen && chosen.run === run ? chosen.m : -1;
  drawStill(k, [run.poses, run.map && run.map.image, isChosen, $("colour").value, ...shown], () => drawRun(run));
  if (pose && shown.has("scan")) drawScan(pose, pointsOf(run, i), 0.01);
  if (pose) drawRobot(pose, run.covariances.subarray(4 * i, 4 * i + 4), k === 0);
  if (k === 0 && mending) drawMending(run);
  if (runs.length > 1) {
    pen.fillStyle = colours.text; pen.font = "600 14px system-ui, sans-serif"; pen.textAlign = "left";
    pen.fillText(`${run.name} (${run.mode})`, pane.cx - 0.5 * pane.w + 8, pane.cy - 0.5 * pane.h + 16);
  }
};

function drawRun(run) {
  if (shown.has("map")) drawMap(run.map);
  for (const name of ["wheels", "odometry"]) if (shown.has(name) && run[name]) drawPath(run[name], 3, colours[name], { width: 1.5, dash: [6, 4] });
  if (run.closures) drawClosures(run);
  if (shown.has("path")) drawTrack(run);
  if (shown.has("ellipses") && run.keyframes) drawEllipses(run.keyframes, run.keyframe_covariances);
  else if (shown.has("ellipses")) drawEllipses(run.poses, run.covariances);
  if (shown.has("keyframes") && run.keyframes) drawKeyframes(run);
  drawRings(run.contradicted || [], 16, colours.bad);
}
function drawRings(places, radius, colour) {
  pen.strokeStyle = colour; pen.lineWidth = 2.5;
  for (let i = 0; i < places.length; i += 2) { const [u, v] = toScreen(places[i], places[i + 1]); pen.beginPath(); pen.arc(u, v, radius, 0, 2 * Math.PI); pen.stroke(); }
}

function drawTrack(run) {
  const kind = $("colour").value;
  if (kind === "plain") { drawPath(run.poses, 3, colours.path); return; }
  const range = [Math.min(...runs.map((r) => r.range[0])), Math.max(...runs.map((r) => r.range[1]))];
  const isTime = kind === "time", key = kind + range;
  if (run.key !== key) { run.key = key; run.tones = toneOf(run, kind, range); }
  drawPath(run.poses, 3, colours.path, { toneOf: run.tones, tones: TONES, width: 2.5 });
  const ends = isTime ? ["0:00", clock(runs[0].stamps[runs[0].stamps.length - 1] || 0)] : range.map((v) => (isFinite(v) ? spread(v) : "–"));
  $("ramp-from").textContent = ends[0]; $("ramp-to").textContent = ends[1];
}

function drawEllipses(poses, covariances) {
  let pu = NaN, pv = NaN;
  for (let i = 0; 3 * i < poses.length; i++) {
    const [u, v] = toScreen(poses[3 * i], poses[3 * i + 1]);
    const wide = view.scale * Math.sqrt(covariances[4 * i] + covariances[4 * i + 2]);
    if (Math.hypot(u - pu, v - pv) < Math.max(22, 0.8 * wide) || u < pane.x0 - 200 || u > pane.x1 + 200 || v < pane.y0 - 200 || v > pane.y1 + 200) continue;
    [pu, pv] = [u, v];
    drawEllipse(poses[3 * i], poses[3 * i + 1], covariances.subarray(4 * i, 4 * i + 3), { alpha: 0.06 });
  }
}
function drawKeyframes(run) {
  const p = run.keyframes, half = view.scale > 40 ? 3 : 2;
  pen.fillStyle = colours.text;
  for (let i = 0; i < p.length; i += 3) { const [u, v] = toScreen(p[i], p[i + 1]); pen.fillRect(u - half, v - half, 2 * half, 2 * half); }
}

function drawClosures(run) {
  const { places, kind, kinds } = run.closures, lines = kinds.map(() => []);
  for (let m = 0; m < kind.length; m++) if (shown.has("closure " + kinds[kind[m]][0])) lines[kind[m]].push(...places.subarray(4 * m, 4 * m + 4));
  kinds.forEach(([, , isAccepted], k) => drawLinks(lines[k], isAccepted ? colours.closure : colours.bad, isAccepted ? 0.45 : 0.6));
  if (chosen && chosen.run === run) { const ends = places.subarray(4 * chosen.m, 4 * chosen.m + 4); pen.lineWidth = 3; drawLinks(ends, colours.warn, 1); drawRings(ends, 7, colours.warn); }
}

function listKinds() {
  const all = new Map();
  for (const run of runs) for (const [name, text, isAccepted, n] of (run.closures ? run.closures.kinds : [])) {
    const one = all.get(name) || { text, isAccepted, n: 0 };
    one.n += n; all.set(name, one);
  }
  $("kinds").replaceChildren(...[...all].sort(([, a], [, b]) => b.isAccepted - a.isAccepted || b.n - a.n).map(([name, { text, isAccepted, n }]) => {
    const label = document.createElement("label"), box = document.createElement("input"), mark = document.createElement("i");
    box.type = "checkbox"; box.id = "closure-" + name; box.checked = shown.has("closure " + name) || (!shown.has("asked " + name) && isAccepted && !name.includes("("));
    mark.className = isAccepted ? "closure" : "refused";
    if (box.checked) shown.add("closure " + name);
    box.addEventListener("change", () => { shown.add("asked " + name); shown[box.checked ? "add" : "delete"]("closure " + name); redraw(); });
    label.append(box, mark, `${n.toLocaleString("en")} ${name.replaceAll("_", " ")}`); label.title = text;
    return label;
  }));
}

// the closure nearest to where the page was clicked, among those that are shown
stage.onPick = (k, x, y) => {
  const run = runs[k];
  if (mending && k === 0 && pickForMending(run, x, y)) return;
  if (!run || !run.closures) return;
  const { places, kind, kinds } = run.closures, reach = 10 / view.scale;
  let best = reach, m = -1;
  for (let i = 0; i < kind.length; i++) {
    if (!shown.has("closure " + kinds[kind[i]][0])) continue;
    const d = toSegment(x, y, places.subarray(4 * i, 4 * i + 4));
    if (d < best) [best, m] = [d, i];
  }
  chosen = m < 0 ? null : { run, m };
  showClosure(); redraw();
};
function toSegment(x, y, [a, b, c, d]) {
  const dx = c - a, dy = d - b, t = Math.min(Math.max(((x - a) * dx + (y - b) * dy) / Math.max(dx * dx + dy * dy, 1e-12), 0), 1);
  return Math.hypot(x - a - t * dx, y - b - t * dy);
}
function showClosure() {
  $("of-closure").hidden = true;
  if (!chosen) { $("closure").textContent = "Click a line to read why."; return; }
  const { run, m } = chosen, { rows, figures, kind, kinds } = run.closures, [name, text, isAccepted] = kinds[kind[m]];
  const [score, confidence, distance] = figures.subarray(3 * m, 3 * m + 3), [i, j] = rows.subarray(2 * m, 2 * m + 2);
  const ends = i >= 0 && j >= 0 ? `Keyframes ${i} and ${j}. ` : "One of its keyframes has gone. ";
  const figure = (what, v) => (v === v ? ` ${what} ${v.toPrecision(3)}.` : "");
  $("closure").textContent = `${ends}${isAccepted ? "Accepted" : "Refused"}: ${text}` +
    figure("Confidence", confidence) + figure("Score", score) + figure("Squared distance from the graph", distance);
  if (mending && run === runs[0] && i >= 0 && j >= 0) offerDrop(i, j, isAccepted || name.startsWith("left_out"));
}

for (const name of ["map", "path", "scan", "ellipses", "keyframes", "odometry", "wheels"]) {
  $("show-" + name).addEventListener("change", (e) => { shown[e.target.checked ? "add" : "delete"](name); redraw(); });
}
$("colour").addEventListener("change", (e) => { $("ramp").hidden = e.target.value === "plain"; redraw(); });
$("more").addEventListener("toggle", redraw);
$("time").addEventListener("input", (e) => goTo(Number(e.target.value)));
$("play").addEventListener("click", () => {
  playing = playing ? 0 : performance.now(); $("play").textContent = playing ? "⏸" : "▶";
  if (playing) { if (at >= runs[0].stamps.length - 1) goTo(0); requestAnimationFrame(step); }
});
const PLAYED_S = 40; // a whole run takes so long to play, seconds
let share = 0;
function step(now) {
  if (!playing) return;
  share += ((now - playing) / (1e3 * PLAYED_S)) * runs[0].stamps.length; playing = now;
  const whole = Math.floor(share); share -= whole;
  if (whole) goTo(at + whole);
  if (at >= runs[0].stamps.length - 1) $("play").click(); else requestAnimationFrame(step);
}
addEventListener("keydown", (e) => {
  if (["INPUT", "SELECT"].includes(e.target.tagName)) return;
  if (e.key === "ArrowRight") goTo(at + (e.shiftKey ? 50 : 1));
  if (e.key === "ArrowLeft") goTo(at - (e.shiftKey ? 50 : 1));
});

// mending: the page keeps the edits, and sends all of them with each request
async function beginMending() {
  const answer = await fetch("token");
  if (!answer.ok) return; // others may look on: nothing can be changed
  setToken(await answer.text());
  mending = { edits: [], mode: null, picked: [], answer: null };
  $("mend").hidden = false;
  for (const mode of ["add", "pin", "forbid"]) $(mode).addEventListener("click", () => setMode(mending.mode === mode ? null : mode));
  $("take").addEventListener("click", () => { const { edit } = mending.answer; setMode(null); take(edit); });
  $("leave").addEventListener("click", () => setMode(null));
  $("undo").addEventListener("click", () => { mending.edits.pop(); optimize(); });
  $("optimize").addEventListener("click", optimize);
  $("save-map").addEventListener("click", () => save("map", "map.csmap"));
  $("save-edits").addEventListener("click", () => save("edits", "edits.json"));
  listEdits();
}
const HINTS = { add: "Pick two keyframes that show the same place.", pin: "Pick the keyframe that stays.", forbid: "Pick the first and the last keyframe of the stretch." };
function setMode(mode) {
  Object.assign(mending, { mode, picked: [], answer: null });
  for (const name of ["add", "pin", "forbid"]) $(name).setAttribute("aria-pressed", String(name === mode));
  $("hint").textContent = mode ? HINTS[mode] : ""; $("answer").hidden = true;
  redraw();
}
function pickForMending(run, x, y) {
  const { mode, picked } = mending, p = run.keyframes;
  if (!mode || mending.answer) return mode !== null;
  let best = 20 / view.scale, row = -1;
  for (let k = 0; 3 * k < p.length; k++) { const d = Math.hypot(p[3 * k] - x, p[3 * k + 1] - y); if (d < best) [best, row] = [d, k]; }
  if (row >= 0 && !picked.includes(row)) pick(row);
  redraw();
  return true;
}
async function pick(row) {
  const { mode, picked } = mending;
  picked.push(row);
  const [i, j] = picked;
  if (mode === "pin") { const pose = [...runs[0].keyframes.subarray(3 * i, 3 * i + 3)]; setMode(null); await take({ do: "pin", i, j: i, pose }); }
  else if (picked.length < 2) $("hint").textContent = `Keyframe ${i}. Pick the other one.`;
  else if (mode === "forbid") { setMode(null); await take({ do: "forbid", i, j }); }
  else {
    const answer = await (await post("match", { i, j })).json();
    if (mending.mode !== mode) return;
    $("hint").textContent = `Keyframes ${i} and ${j}: ${answer.sentence}`;
    if (answer.edit) { mending.answer = answer; $("answer").hidden = false; } else mending.picked = [];
    redraw();
  }
}
function offerDrop(i, j, isInMap) {
  if (!isInMap) return;
  const button = document.createElement("button");
  button.type = "button"; button.id = "drop"; button.textContent = "Drop it";
  button.addEventListener("click", () => { chosen = null; showClosure(); take({ do: "drop", i, j }); });
  $("of-closure").replaceChildren(button); $("of-closure").hidden = false;
}
async function take(edit) {
  mending.edits.push(edit); listEdits();
  await optimize().catch(() => { mending.edits.pop(); listEdits(); });
}
async function optimize() {
  listEdits();
  const tree = await unpack(await (await post("optimize", { edits: mending.edits })).arrayBuffer());
  Object.assign(runs[0], tree, { key: null });
  await prepare(runs[0]);
  chosen = null; showClosure(); listKinds(); goTo(at);
}
function listEdits() {
  $("edits").replaceChildren(...mending.edits.map(({ do: what, i, j }) => {
    const item = document.createElement("li");
    item.textContent = what === "pin" ? `pin ${i}` : what === "forbid" ? `forbid ${i} to ${j}` : `${what} ${i} – ${j}`;
    return item;
  }));
  $("undo").disabled = $("save-edits").disabled = !mending.edits.length;
}
const save = (name, file) => download(name, { edits: mending.edits }, file);
function drawMending(run) {
  if (mending.mode && !shown.has("keyframes")) drawKeyframes(run);
  drawRings(mending.picked.flatMap((k) => [run.keyframes[3 * k], run.keyframes[3 * k + 1]]), 8, colours.warn);
  if (mending.answer) drawScan(mending.answer.pose, mending.answer.points, 0.01, colours.warn);
}
begin().catch((error) => { $("verdict").hidden = false; chip("verdict", "bad", `This page could not be read: ${error.message}`); });
