"use strict";
// What the server sends: about, status, path, map, closures, times, scan. Nothing is ever sent to it.
const $ = (id) => document.getElementById(id);
const canvas = $("canvas"), pen = canvas.getContext("2d");
const state = { path: [], map: null, image: null, closures: [], scan: null, times: [], isOver: false };
const view = { x: 0, y: 0, scale: 40, isFitted: true, isFollowing: false };
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const isDark = matchMedia("(prefers-color-scheme: dark)");
let colours = {}, isDrawn = false;

function readColours() {
  for (const name of ["ground", "grid", "path", "scan", "ellipse", "closure", "quiet", "text", "line"]) colours[name] = css("--" + name);
  redraw();
}
isDark.addEventListener("change", () => { readColours(); if (state.map) loadMap(state.map); });

function listen() {
  const events = new EventSource("events");
  const on = (name, take) => events.addEventListener(name, (e) => { take(JSON.parse(e.data)); redraw(); });
  on("about", (a) => {
    $("name").textContent = a.name; $("mode").textContent = a.mode; document.title = `${a.name} – curvescan live`;
    document.body.classList.toggle("slam", a.mode === "SLAM");
    state.path = []; state.closures = [];
  });
  on("status", showStatus);
  on("path", (p) => { state.path.length = 2 * p.start; for (const v of p.points) state.path.push(v); });
  on("map", loadMap);
  on("closures", (c) => { state.closures = c.lines; });
  on("times", (t) => { state.times = t.ms; });
  on("scan", (s) => { state.scan = s; state.times.push(s.ms); if (state.times.length > 120) state.times.shift(); showFigures(s); });
  events.onerror = () => { if (!state.isOver) showMessage("The connection is lost; trying again."); else events.close(); };
  events.onopen = () => { if (!state.isOver) showMessage(""); };
}

function showStatus(s) {
  state.isOver = s.kind === "ended" || s.kind === "error";
  if (s.kind === "loading") chip("waiting", s.text);
  showMessage(s.kind === "running" || s.kind === "loading" ? "" : s.text);
}
function showMessage(text) { $("message").textContent = text; $("message").hidden = !text; }
function chip(tone, text) { $("outcome").className = "chip " + tone; $("outcome-text").textContent = text; }

function loadMap(map) {
  // two pictures at once would come in any order: the newest wins
  state.newest = map.version;
  const image = new Image();
  image.onload = () => { if (map.version === state.newest) { state.map = map; state.image = toned(image); redraw(); } };
  image.src = "map.png?" + map.version;
}

function toned(image) {
  // white free space would glare on a dark page: there free space is dark grey and obstacles are light
  if (!isDark.matches) return image;
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [image.width, image.height];
  const p = copy.getContext("2d");
  p.drawImage(image, 0, 0);
  p.globalCompositeOperation = "difference"; p.fillStyle = "#d2cdc8"; p.fillRect(0, 0, copy.width, copy.height);
  p.globalCompositeOperation = "destination-in"; p.drawImage(image, 0, 0);
  return copy;
}

const spread = (sigma) => (sigma < 1 ? `${(1e3 * sigma).toFixed(sigma < 0.01 ? 1 : 0)} mm` : `${sigma.toFixed(1)} m`);
const metres = (v, sigma) => `${v.toFixed(3)} m ± ${spread(sigma)}`;
function showPose(s) {
  if (!s.pose) { for (const name of ["x", "y", "theta"]) $(name).textContent = "–"; return; }
  const [x, y, theta] = s.pose, [xx, , yy, tt] = s.covariance, deg = 180 / Math.PI;
  $("x").textContent = metres(x, Math.sqrt(xx));
  $("y").textContent = metres(y, Math.sqrt(yy));
  $("theta").textContent = `${(theta * deg).toFixed(2)}° ± ${(Math.sqrt(tt) * deg).toFixed(2)}°`;
}
function showFigures(s) {
  showPose(s);
  $("ms").textContent = `${s.ms_median.toFixed(1)}, max ${s.ms_max.toFixed(0)}`;
  $("scans").textContent = (s.index + 1).toLocaleString("en");
  $("rate").textContent = s.rate === null ? "–" : `${s.rate.toFixed(1)} Hz`;
  $("length").textContent = `${s.length.toFixed(1)} m`;
  $("score").textContent = s.score === null ? "–" : s.score.toFixed(2);
  for (const name of ["n_closures", "n_lost", "n_dropped"]) $(name).textContent = s[name].toLocaleString("en");
  const tone = !s.is_matched ? "bad" : s.degenerate ? "warn" : "good";
  chip(tone, s.sentence + (s.degenerate ? " One direction is unobservable." : ""));
  spark();
}

function spark() {
  const c = $("spark"), ratio = devicePixelRatio || 1, w = c.clientWidth, h = c.clientHeight;
  c.width = w * ratio; c.height = h * ratio;
  const p = c.getContext("2d");
  p.scale(ratio, ratio);
  const top = 1.15 * Math.max(...state.times), step = w / 120;
  p.fillStyle = colours.path; p.globalAlpha = 0.8;
  state.times.forEach((t, i) => { const bar = Math.max(1, (h * t) / top); p.fillRect(i * step, h - bar, Math.max(step - 1, 1), bar); });
}

const isPlaced = () => state.scan !== null && state.scan.pose !== null;
function redraw() { if (!isDrawn) { isDrawn = true; requestAnimationFrame(() => { isDrawn = false; draw(); }); } }

function bounds() {
  const b = [Infinity, Infinity, -Infinity, -Infinity];
  const take = (x, y) => { b[0] = Math.min(b[0], x); b[1] = Math.min(b[1], y); b[2] = Math.max(b[2], x); b[3] = Math.max(b[3], y); };
  if (state.map) {
    const { origin: [x, y], resolution: r, shape: [rows, columns] } = state.map;
    take(x, y); take(x + r * columns, y + r * rows);
  }
  for (let i = 0; i < state.path.length; i += 2) take(state.path[i], state.path[i + 1]);
  if (!state.map && isPlaced()) for (const [x, y] of scanPoints()) take(x, y);
  return b;
}

function fit() {
  const b = bounds();
  if (!isFinite(b[0])) return;
  const panel = $("panel").getBoundingClientRect(), isNarrow = panel.width > 0.6 * innerWidth;
  const left = isNarrow ? 20 : panel.right + 20, above = isNarrow ? panel.bottom + 20 : 24;
  const below = isNarrow ? 120 : 60; // buttons, and the message above them
  const width = Math.max(innerWidth - left - 24, 60), height = Math.max(innerHeight - above - below, 60);
  view.scale = Math.min(width / Math.max(b[2] - b[0], 2), height / Math.max(b[3] - b[1], 2), 200);
  // the middle of what is free of the panel shows the middle of the map
  view.x = 0.5 * (b[0] + b[2]) - (left + 0.5 * width - 0.5 * innerWidth) / view.scale;
  view.y = 0.5 * (b[1] + b[3]) + (above + 0.5 * height - 0.5 * innerHeight) / view.scale;
}

const toScreen = (x, y) => [0.5 * innerWidth + (x - view.x) * view.scale, 0.5 * innerHeight - (y - view.y) * view.scale];

function scanPoints() {
  const [x, y, theta] = state.scan.pose, c = Math.cos(theta), s = Math.sin(theta), out = [], p = state.scan.points;
  for (let i = 0; i < p.length; i += 2) out.push([x + 1e-3 * (c * p[i] - s * p[i + 1]), y + 1e-3 * (s * p[i] + c * p[i + 1])]);
  return out;
}

function draw() {
  const ratio = devicePixelRatio || 1;
  if (canvas.width !== Math.round(innerWidth * ratio) || canvas.height !== Math.round(innerHeight * ratio)) {
    canvas.width = Math.round(innerWidth * ratio); canvas.height = Math.round(innerHeight * ratio);
  }
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  if (view.isFitted) fit();
  else if (view.isFollowing && isPlaced()) { [view.x, view.y] = state.scan.pose; }
  pen.fillStyle = colours.ground; pen.fillRect(0, 0, innerWidth, innerHeight);
  drawGrid(); drawMap(); drawClosures(); drawPath();
  if (isPlaced()) { drawScan(); drawRobot(); }
  drawScale();
}

function drawGrid() {
  const step = niceStep(60 / view.scale), [x0, y0] = [view.x - 0.5 * innerWidth / view.scale, view.y - 0.5 * innerHeight / view.scale];
  pen.strokeStyle = colours.grid; pen.lineWidth = 1; pen.beginPath();
  for (let x = Math.floor(x0 / step) * step; x < x0 + innerWidth / view.scale; x += step) { const [u] = toScreen(x, 0); pen.moveTo(u, 0); pen.lineTo(u, innerHeight); }
  for (let y = Math.floor(y0 / step) * step; y < y0 + innerHeight / view.scale; y += step) { const [, v] = toScreen(0, y); pen.moveTo(0, v); pen.lineTo(innerWidth, v); }
  pen.stroke();
}
function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return power * [1, 2, 5, 10].find((m) => m * power >= least);
}

function drawMap() {
  if (!state.map) return;
  const { origin: [x, y], resolution: r, shape: [rows, columns] } = state.map;
  const [u, v] = toScreen(x, y + r * rows);
  pen.imageSmoothingEnabled = view.scale * r < 2;
  pen.drawImage(state.image, u, v, columns * r * view.scale, rows * r * view.scale);
}

function drawPath() {
  const p = state.path;
  if (p.length < 2) return;
  pen.beginPath();
  for (let i = 0; i < p.length; i += 2) { const [u, v] = toScreen(p[i], p[i + 1]); if (i) pen.lineTo(u, v); else pen.moveTo(u, v); }
  if (isPlaced()) pen.lineTo(...toScreen(state.scan.pose[0], state.scan.pose[1]));
  pen.strokeStyle = colours.path; pen.lineWidth = 2; pen.lineJoin = "round"; pen.stroke();
}

function drawClosures() {
  const c = state.closures;
  pen.strokeStyle = pen.fillStyle = colours.closure; pen.lineWidth = 1; pen.globalAlpha = 0.45;
  for (let i = 0; i + 3 < c.length; i += 4) {
    const [a, b] = toScreen(c[i], c[i + 1]), [d, e] = toScreen(c[i + 2], c[i + 3]);
    pen.beginPath(); pen.moveTo(a, b); pen.lineTo(d, e); pen.stroke();
    pen.fillRect(a - 1.5, b - 1.5, 3, 3); pen.fillRect(d - 1.5, e - 1.5, 3, 3);
  }
  pen.globalAlpha = 1;
}

function drawScan() {
  pen.fillStyle = colours.scan;
  const half = Math.min(Math.max(0.03 * view.scale, 1.1), 2.2);
  for (const [x, y] of scanPoints()) { const [u, v] = toScreen(x, y); pen.fillRect(u - half, v - half, 2 * half, 2 * half); }
}

function drawRobot() {
  const [x, y, theta] = state.scan.pose, [xx, xy, yy] = state.scan.covariance, [u, v] = toScreen(x, y);
  const mean = 0.5 * (xx + yy), half = Math.hypot(0.5 * (xx - yy), xy);
  const long = 3 * Math.sqrt(mean + half), short = 3 * Math.sqrt(Math.max(mean - half, 0)), turn = 0.5 * Math.atan2(2 * xy, xx - yy);
  // an ellipse of millimetres is seen only when drawn larger, and says so
  let times = 1;
  while (long > 0 && times < 10000 && long * times * view.scale < 16) times = niceStep(1.5 * times);
  $("ellipse-label").textContent = "3σ of the position" + (times > 1 ? `, ×${times}` : "");
  pen.save(); pen.translate(u, v);
  if (long > 0) {
    pen.beginPath(); pen.ellipse(0, 0, long * times * view.scale, Math.max(short * times * view.scale, 1), -turn, 0, 2 * Math.PI);
    pen.strokeStyle = colours.ellipse; pen.lineWidth = 2; pen.stroke();
    pen.globalAlpha = 0.15; pen.fillStyle = colours.ellipse; pen.fill(); pen.globalAlpha = 1;
  }
  pen.rotate(-theta);
  pen.beginPath(); pen.moveTo(12, 0); pen.lineTo(-7, 7); pen.lineTo(-4, 0); pen.lineTo(-7, -7); pen.closePath();
  pen.fillStyle = colours.path; pen.strokeStyle = "#fff"; pen.lineWidth = 1.5; pen.fill(); pen.stroke();
  pen.restore();
}

function drawScale() {
  const step = niceStep((innerWidth > 640 ? 70 : 40) / view.scale);
  $("scale-bar").style.width = `${step * view.scale}px`;
  $("scale-label").textContent = step < 1 ? `${Math.round(100 * step)} cm` : `${step} m`;
}

function choose(isFitted, isFollowing) {
  view.isFitted = isFitted; view.isFollowing = isFollowing;
  $("follow").setAttribute("aria-pressed", String(isFollowing)); $("fit").setAttribute("aria-pressed", String(isFitted));
  redraw();
}
function zoom(factor, u, v) {
  const dx = (u - 0.5 * innerWidth) / view.scale, dy = (0.5 * innerHeight - v) / view.scale;
  view.scale = Math.min(Math.max(view.scale * factor, 0.5), 2000);
  if (!view.isFollowing) { view.x += dx - (u - 0.5 * innerWidth) / view.scale; view.y += dy - (0.5 * innerHeight - v) / view.scale; }
  choose(false, view.isFollowing);
}
$("follow").addEventListener("click", () => { if (!view.isFollowing) view.scale = Math.max(view.scale, 60); choose(false, !view.isFollowing); });
$("fit").addEventListener("click", () => choose(true, false));
addEventListener("keydown", (e) => {
  if (e.target.tagName === "BUTTON") return;
  if (e.key === " ") choose(true, false);
  if (e.key === "f") $("follow").click();
});
canvas.addEventListener("wheel", (e) => { e.preventDefault(); zoom(Math.exp(-0.0015 * e.deltaY), e.clientX, e.clientY); }, { passive: false });
const fingers = new Map();
canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); fingers.set(e.pointerId, e); canvas.classList.add("dragging"); });
canvas.addEventListener("pointermove", (e) => {
  const before = fingers.get(e.pointerId);
  if (!before) return;
  if (fingers.size === 2) {
    const [other] = [...fingers.values()].filter((f) => f.pointerId !== e.pointerId);
    const was = Math.hypot(before.clientX - other.clientX, before.clientY - other.clientY);
    const is = Math.hypot(e.clientX - other.clientX, e.clientY - other.clientY);
    if (was > 0 && is > 0) zoom(is / was, 0.5 * (e.clientX + other.clientX), 0.5 * (e.clientY + other.clientY));
  } else {
    view.x -= (e.clientX - before.clientX) / view.scale; view.y += (e.clientY - before.clientY) / view.scale;
    choose(false, false);
  }
  fingers.set(e.pointerId, e);
});
for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (e) => { fingers.delete(e.pointerId); if (!fingers.size) canvas.classList.remove("dragging"); });
addEventListener("resize", redraw);
readColours(); choose(true, false); listen();
