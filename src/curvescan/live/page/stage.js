"use strict";
// What the pages of `live` and `view` share: a canvas of one or two panes, panning and zooming, and what is drawn on it.
const $ = (id) => document.getElementById(id);
const canvas = $("canvas");
let pen = canvas.getContext("2d");
const view = { x: 0, y: 0, scale: 40, isFitted: true, isFollowing: false };
// a page says how many panes there are, draws one, names the places that are to be seen, and the one to follow
const stage = { n: 1, draw: (k) => {}, places: (take) => {}, target: () => null, panes: [], onPick: null };
const isDark = matchMedia("(prefers-color-scheme: dark)");
const SIGMAS_95 = Math.sqrt(5.991); // chi-square of two degrees of freedom, 95 %
let colours = {}, isDrawn = false, pane = null;

const NAMES = ["ground", "grid", "path", "scan", "ellipse", "closure", "quiet", "text", "line", "good", "warn", "bad", "wheels", "odometry"];
function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of NAMES) colours[name] = style.getPropertyValue("--" + name).trim();
  redraw();
}
isDark.addEventListener("change", readColours);

function showMessage(text) { $("message").textContent = text; $("message").hidden = !text; redraw(); }
function chip(id, tone, text, title = "") {
  $(id).className = "chip " + tone; $(id).lastElementChild.textContent = text; $(id).title = title;
}

// what a page asks its server for carries the token that only a page of this server can read
let token = "";
function setToken(text) { token = text; }
async function post(name, body) {
  const headers = { "Content-Type": "application/json", "X-Curvescan-Token": token };
  showMessage("Working …");
  const answer = await fetch("do/" + name, { method: "POST", headers, body: JSON.stringify(body) }).catch(() => null);
  showMessage("");
  if (answer && answer.ok) return answer;
  const told = answer && answer.status === 422 ? (await answer.json()).error : "The server does not answer.";
  showMessage(told);
  throw new Error(told);
}
async function download(name, body, file) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await (await post(name, body)).blob()); link.download = file;
  link.click(); URL.revokeObjectURL(link.href);
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
function showPose(pose, covariance) {
  if (!pose) { for (const name of ["x", "y", "theta"]) $(name).textContent = "–"; return; }
  const [x, y, theta] = pose, [xx, , yy, tt] = covariance, deg = 180 / Math.PI;
  $("x").textContent = metres(x, Math.sqrt(xx));
  $("y").textContent = metres(y, Math.sqrt(yy));
  $("theta").textContent = `${(theta * deg).toFixed(2)}° ± ${(Math.sqrt(tt) * deg).toFixed(2)}°`;
}

// panes: each has its rectangle, and within it what panel, buttons and timeline leave free
function layOut() {
  const panel = $("panel").getBoundingClientRect(), isNarrow = panel.width > 0.6 * innerWidth;
  const dock = $("dock") ? $("dock").getBoundingClientRect().height + 16 : 0;
  const left = isNarrow ? 20 : panel.right + 20, above = isNarrow ? Math.min(panel.bottom + 20, 0.6 * innerHeight) : 24;
  const message = $("message"), told = message.hidden ? 0 : innerHeight - message.getBoundingClientRect().top + 12;
  const below = Math.max(dock + (isNarrow && !dock ? 120 : 60), told); // buttons, and the message above them
  const width = Math.max(innerWidth - left - 24, 60), height = Math.max(innerHeight - above - below, 60);
  const isStacked = isNarrow || width < 500, w = isStacked ? width : width / stage.n, h = isStacked ? height / stage.n : height;
  stage.panes = Array.from({ length: stage.n }, (_, k) => {
    const at = { x: left + (isStacked ? 0 : k * w), y: above + (isStacked ? k * h : 0), w: w - (stage.n > 1 ? 10 : 0), h };
    const x0 = k && !isStacked ? at.x - 5 : 0, y0 = k && isStacked ? at.y : 0, isLast = k === stage.n - 1;
    const x1 = isLast || isStacked ? innerWidth : at.x + w - 5, y1 = isLast || !isStacked ? innerHeight : at.y + h;
    return { x0, y0, x1, y1, cx: at.x + 0.5 * at.w, cy: at.y + 0.5 * at.h, w: at.w, h: at.h };
  });
  pane = stage.panes[0];
}
const paneAt = (u, v) => Math.max(stage.panes.findIndex((p) => u >= p.x0 && u < p.x1 && v >= p.y0 && v < p.y1), 0);

function fit() {
  const b = [Infinity, Infinity, -Infinity, -Infinity];
  stage.places((x, y) => { b[0] = Math.min(b[0], x); b[1] = Math.min(b[1], y); b[2] = Math.max(b[2], x); b[3] = Math.max(b[3], y); });
  if (!isFinite(b[0])) return;
  view.scale = Math.min(pane.w / Math.max(b[2] - b[0], 2), pane.h / Math.max(b[3] - b[1], 2), 200);
  view.x = 0.5 * (b[0] + b[2]); view.y = 0.5 * (b[1] + b[3]);
}

const toScreen = (x, y) => [pane.cx + (x - view.x) * view.scale, pane.cy - (y - view.y) * view.scale];
const toMap = (u, v, p = pane) => [view.x + (u - p.cx) / view.scale, view.y - (v - p.cy) / view.scale];

function redraw() { if (!isDrawn) { isDrawn = true; requestAnimationFrame(() => { isDrawn = false; draw(); }); } }
function draw() {
  const ratio = devicePixelRatio || 1;
  if (canvas.width !== Math.round(innerWidth * ratio) || canvas.height !== Math.round(innerHeight * ratio)) {
    canvas.width = Math.round(innerWidth * ratio); canvas.height = Math.round(innerHeight * ratio);
  }
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  layOut();
  const target = stage.target();
  if (view.isFitted) fit();
  else if (view.isFollowing && target) [view.x, view.y] = target;
  stage.panes.forEach((p, k) => {
    pane = p;
    pen.save(); pen.beginPath(); pen.rect(p.x0, p.y0, p.x1 - p.x0, p.y1 - p.y0); pen.clip();
    pen.fillStyle = colours.ground; pen.fillRect(p.x0, p.y0, p.x1 - p.x0, p.y1 - p.y0);
    drawGrid(); stage.draw(k);
    pen.restore();
    if (k) { pen.fillStyle = colours.line; pen.fillRect(p.x0 - 1, p.y0 - 1, p.x0 ? 2 : innerWidth, p.y0 ? 2 : innerHeight); }
  });
  const step = niceStep((innerWidth > 640 ? 70 : 40) / view.scale);
  $("scale-bar").style.width = `${step * view.scale}px`;
  $("scale-label").textContent = step < 1 ? `${Math.round(100 * step)} cm` : `${step} m`;
}

// What stays from scan to scan is painted once. Where that takes longer than a frame should, the picture is moved along
// while the view moves, and painted anew a few times a second and when the view rests.
const SLOW_MS = 8, ANEW_MS = 200, REST_MS = 60;
const stills = [];
let resting = 0;
function drawStill(k, key, paint) {
  const s = (stills[k] = stills[k] || { canvas: document.createElement("canvas"), key: null, cost: 0, at: 0 });
  const all = [...key, canvas.width, canvas.height, pane.cx, pane.cy, isDark.matches];
  const isOld = !s.key || all.some((v, i) => v !== s.key[i]) || all.length !== s.key.length;
  const isMoved = s.x !== view.x || s.y !== view.y || s.scale !== view.scale, now = performance.now();
  if (isOld || (isMoved && (s.cost < SLOW_MS || s.isDue || now - s.at > Math.max(ANEW_MS, 4 * s.cost)))) {
    const shown = pen, ratio = devicePixelRatio || 1;
    s.canvas.width = canvas.width; s.canvas.height = canvas.height;
    pen = s.canvas.getContext("2d"); pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    try { paint(); } finally { pen = shown; }
    Object.assign(s, { key: all, x: view.x, y: view.y, scale: view.scale, isDue: false });
    s.at = performance.now(); s.cost = s.at - now;
  } else if (isMoved) {
    clearTimeout(resting);
    resting = setTimeout(() => { for (const one of stills) one.isDue = true; redraw(); }, REST_MS);
  }
  const times = view.scale / s.scale, left = pane.cx + (s.x - view.x) * view.scale - pane.cx * times;
  const top = pane.cy - (s.y - view.y) * view.scale - pane.cy * times;
  pen.drawImage(s.canvas, left, top, innerWidth * times, innerHeight * times);
}

function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return power * [1, 2, 5, 10].find((m) => m * power >= least);
}
function drawGrid() {
  const step = niceStep(60 / view.scale), [left, top] = toMap(pane.x0, pane.y0), [right, bottom] = toMap(pane.x1, pane.y1);
  pen.strokeStyle = colours.grid; pen.lineWidth = 1; pen.beginPath();
  for (let x = Math.floor(left / step) * step; x < right; x += step) { const [u] = toScreen(x, 0); pen.moveTo(u, pane.y0); pen.lineTo(u, pane.y1); }
  for (let y = Math.floor(bottom / step) * step; y < top; y += step) { const [, v] = toScreen(0, y); pen.moveTo(pane.x0, v); pen.lineTo(pane.x1, v); }
  pen.stroke();
}

function drawMap(map) {
  if (!map || !map.image) return;
  if (map.isDark !== isDark.matches) { map.toned = toned(map.image); map.isDark = isDark.matches; }
  const { origin: [x, y], resolution: r, shape: [rows, columns] } = map, [u, v] = toScreen(x, y + r * rows);
  pen.imageSmoothingEnabled = view.scale * r < 2;
  pen.drawImage(map.toned, u, v, columns * r * view.scale, rows * r * view.scale);
}

function drawPath(p, stride, colour, { width = 2, last = null, toneOf = null, tones = null, dash = [] } = {}) {
  // p: x, y and what else there is, `stride` numbers a point; points nearer than a pixel to the one before are left out
  const n = p.length / stride, s = view.scale, u0 = pane.cx - view.x * s, v0 = pane.cy + view.y * s;
  let isOpen = false, pu = 0, pv = 0, tone = null;
  pen.lineWidth = width; pen.lineJoin = "round"; pen.setLineDash(dash); pen.strokeStyle = colour; pen.beginPath();
  for (let i = 0; i < n; i++) {
    const u = u0 + p[stride * i] * s, v = v0 - p[stride * i + 1] * s;
    if (!(u === u)) { isOpen = false; continue; } // not known here
    if (isOpen && i < n - 1 && Math.abs(u - pu) + Math.abs(v - pv) < 1) continue;
    if (tones && toneOf[i] !== tone) {
      pen.stroke(); tone = toneOf[i]; pen.strokeStyle = tones[tone]; pen.beginPath();
      if (isOpen) pen.moveTo(pu, pv);
    }
    if (isOpen) pen.lineTo(u, v); else pen.moveTo(u, v);
    [isOpen, pu, pv] = [true, u, v];
  }
  if (last && isOpen) pen.lineTo(...toScreen(last[0], last[1]));
  pen.stroke(); pen.setLineDash([]);
}

function drawLinks(c, colour, alpha = 0.45) {
  pen.strokeStyle = pen.fillStyle = colour; pen.lineWidth = 1; pen.globalAlpha = alpha; pen.beginPath();
  for (let i = 0; i + 3 < c.length; i += 4) {
    const [a, b] = toScreen(c[i], c[i + 1]), [d, e] = toScreen(c[i + 2], c[i + 3]);
    pen.moveTo(a, b); pen.lineTo(d, e);
    pen.fillRect(a - 1.5, b - 1.5, 3, 3); pen.fillRect(d - 1.5, e - 1.5, 3, 3);
  }
  pen.stroke(); pen.globalAlpha = 1;
}

function drawScan([x, y, theta], points, unit, colour = colours.scan) {
  const c = Math.cos(theta), s = Math.sin(theta), half = Math.min(Math.max(0.03 * view.scale, 1.1), 2.2);
  pen.fillStyle = colour;
  for (let i = 0; i + 1 < points.length; i += 2) {
    const [u, v] = toScreen(x + unit * (c * points[i] - s * points[i + 1]), y + unit * (s * points[i] + c * points[i + 1]));
    pen.fillRect(u - half, v - half, 2 * half, 2 * half);
  }
}

function drawEllipse(x, y, [xx, xy, yy], { isLarge = false, alpha = 0.15 } = {}) {
  const [u, v] = toScreen(x, y), mean = 0.5 * (xx + yy), half = Math.hypot(0.5 * (xx - yy), xy);
  const long = SIGMAS_95 * Math.sqrt(mean + half), short = SIGMAS_95 * Math.sqrt(Math.max(mean - half, 0));
  if (!(long > 0) || !isFinite(long)) return 1;
  // an ellipse of millimetres is seen only when drawn larger, and says so
  let times = 1;
  while (isLarge && times < 10000 && long * times * view.scale < 16) times = niceStep(1.5 * times);
  pen.beginPath();
  pen.ellipse(u, v, long * times * view.scale, Math.max(short * times * view.scale, 1), -0.5 * Math.atan2(2 * xy, xx - yy), 0, 2 * Math.PI);
  pen.strokeStyle = pen.fillStyle = colours.ellipse; pen.lineWidth = isLarge ? 2 : 1; pen.stroke();
  pen.globalAlpha = alpha; pen.fill(); pen.globalAlpha = 1;
  return times;
}

function drawRobot([x, y, theta], covariance, labelled) {
  const times = drawEllipse(x, y, covariance, { isLarge: true }), [u, v] = toScreen(x, y);
  if (labelled) $("ellipse-label").textContent = "95 % of the position" + (times > 1 ? `, ×${times}` : "");
  pen.save(); pen.translate(u, v); pen.rotate(-theta);
  pen.beginPath(); pen.moveTo(12, 0); pen.lineTo(-7, 7); pen.lineTo(-4, 0); pen.lineTo(-7, -7); pen.closePath();
  pen.fillStyle = colours.path; pen.strokeStyle = "#fff"; pen.lineWidth = 1.5; pen.fill(); pen.stroke();
  pen.restore();
}

function choose(isFitted, isFollowing) {
  view.isFitted = isFitted; view.isFollowing = isFollowing;
  $("follow").setAttribute("aria-pressed", String(isFollowing)); $("fit").setAttribute("aria-pressed", String(isFitted));
  redraw();
}
function zoom(factor, u, v) {
  const p = stage.panes[paneAt(u, v)], [x, y] = toMap(u, v, p);
  view.scale = Math.min(Math.max(view.scale * factor, 0.5), 2000);
  if (!view.isFollowing) { view.x = x - (u - p.cx) / view.scale; view.y = y + (v - p.cy) / view.scale; }
  choose(false, view.isFollowing);
}
$("follow").addEventListener("click", () => { if (!view.isFollowing) view.scale = Math.max(view.scale, 60); choose(false, !view.isFollowing); });
$("fit").addEventListener("click", () => choose(true, false));
addEventListener("keydown", (e) => {
  if (["BUTTON", "INPUT", "SELECT", "SUMMARY"].includes(e.target.tagName)) return;
  if (e.key === " ") choose(true, false);
  if (e.key === "f") $("follow").click();
});
canvas.addEventListener("wheel", (e) => { e.preventDefault(); zoom(Math.exp(-0.0015 * e.deltaY), e.clientX, e.clientY); }, { passive: false });
const fingers = new Map();
let pressed = null;
canvas.addEventListener("pointerdown", (e) => {
  canvas.setPointerCapture(e.pointerId); fingers.set(e.pointerId, e); canvas.classList.add("dragging");
  pressed = fingers.size === 1 ? e : null;
});
canvas.addEventListener("pointermove", (e) => {
  const before = fingers.get(e.pointerId);
  if (!before) return;
  if (pressed && Math.hypot(e.clientX - pressed.clientX, e.clientY - pressed.clientY) > 4) pressed = null;
  if (fingers.size === 2) {
    const [other] = [...fingers.values()].filter((f) => f.pointerId !== e.pointerId);
    const was = Math.hypot(before.clientX - other.clientX, before.clientY - other.clientY);
    const is = Math.hypot(e.clientX - other.clientX, e.clientY - other.clientY);
    if (was > 0 && is > 0) zoom(is / was, 0.5 * (e.clientX + other.clientX), 0.5 * (e.clientY + other.clientY));
  } else if (!pressed) {
    view.x -= (e.clientX - before.clientX) / view.scale; view.y += (e.clientY - before.clientY) / view.scale;
    choose(false, false);
  }
  fingers.set(e.pointerId, e);
});
for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (e) => {
  fingers.delete(e.pointerId);
  if (!fingers.size) canvas.classList.remove("dragging");
  if (pressed && name === "pointerup" && stage.onPick) {
    const k = paneAt(e.clientX, e.clientY);
    stage.onPick(k, ...toMap(e.clientX, e.clientY, stage.panes[k]));
  }
  pressed = null;
});
addEventListener("resize", redraw);
