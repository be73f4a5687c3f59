// The map of the flight on a canvas. `setScene` sets the scene once, `applyDelta` applies each change.

import { Board, Raster, drawTraffic, inkOn } from "flight_board";

const RESULTS_MS = 5000; // time between two loads of the pictures of the results
const EASE_S = 0.35; // time in which a marker glides to the reported place of its vehicle

export class FlightMap {
  constructor(canvas) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d");
    this.base = document.createElement("canvas");
    this.raster = new Raster();
    this.board = new Board();
    this.scene = null;
    this.background = null; // picture of the ground
    this.mosaic = null; // mosaic of the flight, over the background
    this.onresults = () => {}; // called when the results may have new pictures
    this.due_ms = 0;
    this.shown = {}; // places at which the markers are drawn
    this.view = null;
    this.stale = true; // the base must be drawn again
    this.moving = true;
    this.frames = 0; // number of drawings
    this.drawn_ms = 0; // time for all drawings
    this.last_ms = 0;
    this.fingers = new Map();
    this.listen();
    const tick = (now_ms) => {
      if (!this.canvas.isConnected && this.over) return;
      this.frame(now_ms);
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  setScene(scene) {
    this.scene = scene;
    this.colours = scene.states.map(([, colour]) => colour);
    this.view = null;
    this.stale = true;
    this.background = this.mosaic = this.asked = null;
    this.due_ms = 0;
    if (scene.background) this.load("background", "background");
    this.loadResults();
  }

  load(name, url) {
    const image = new Image();
    image.onload = () => {
      this[name] = image;
      this.stale = true;
    };
    image.src = url;
  }

  // load the pictures of the results again during the mission, and once more at its end
  loadResults() {
    const { t_s, hands_off } = this.board.fields;
    const asked = encodeURIComponent(`${Math.round(t_s || 0)} ${hands_off}`);
    const due = hands_off !== this.hands_off || performance.now() >= this.due_ms;
    if (this.asked === asked || !due) return;
    this.asked = asked;
    this.hands_off = hands_off;
    this.due_ms = performance.now() + RESULTS_MS;
    if (this.scene.mosaic) this.load("mosaic", `result/mosaic.webp?${asked}`);
    this.onresults(asked);
  }

  applyDelta(delta) {
    if (delta.since === 0) this.raster.clear();
    const good = this.board.apply(delta, (column, row, code) =>
      this.raster.set(column, row, this.colours[code] || "#f0f"),
    );
    if (delta.since === 0) this.shown = {};
    this.stale = true;
    this.loadResults();
    return good;
  }

  // --- the view
  fit() {
    const points = [...this.scene.box, this.scene.home];
    const area = (some) => {
      const e = some.map((p) => p[0]);
      const n = some.map((p) => p[1]);
      return [Math.min(...e), Math.min(...n), Math.max(...e), Math.max(...n)];
    };
    const size = ([w, s, e, n]) => (e - w) * (n - s);
    const [de, dn] = this.drifted();
    const vehicles = Object.values(this.board.vehicles).map((v) => [v.e, v.n]);
    const seen = (some) => area([...some.map(([e, n]) => [e - de, n - dn]), ...vehicles]);
    let bounds = seen(points);
    const whole = seen([...points, ...this.scene.fence]);
    if (size(whole) <= 2.2 * size(bounds)) bounds = whole;
    if (this.raster.seen) {
      const [west, south, east, north] = this.raster.seen.map((i) => i * this.scene.cell_m);
      bounds = area([
        [bounds[0], bounds[1]],
        [bounds[2], bounds[3]],
        [west, south],
        [east, north],
      ]);
    }
    const { width, height } = this.canvas;
    const [w, s, e, n] = bounds;
    const scale = 0.92 * Math.min(width / Math.max(e - w, 1), height / Math.max(n - s, 1));
    this.view = { east: (w + e) / 2, north: (s + n) / 2, scale };
    this.stale = true;
  }

  drifted() {
    const t_s = this.board.fields.t_s || 0;
    const [e, n] = this.scene.drift_m_s;
    return [e * t_s, n * t_s];
  }

  at(east, north) {
    const { view, canvas } = this;
    return [
      (east - view.east) * view.scale + canvas.width / 2,
      canvas.height / 2 - (north - view.north) * view.scale,
    ];
  }

  zoom(factor, x, y) {
    const { view, canvas } = this;
    if (!view) return;
    const scale = Math.min(Math.max(view.scale * factor, 0.02), 400);
    const east = view.east + (x - canvas.width / 2) / view.scale;
    const north = view.north - (y - canvas.height / 2) / view.scale;
    view.east = east - (x - canvas.width / 2) / scale;
    view.north = north + (y - canvas.height / 2) / scale;
    view.scale = scale;
    this.touched = this.stale = true;
  }

  listen() {
    const { canvas, fingers } = this;
    const ratio = () => canvas.width / canvas.clientWidth;
    const place = (event) => [event.offsetX * ratio(), event.offsetY * ratio()];
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.zoom(Math.exp(-event.deltaY / 400), ...place(event));
      },
      { passive: false },
    );
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, place(event));
    });
    for (const name of ["pointerup", "pointercancel"])
      canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before || !this.view) return;
      const now = place(event);
      const other = [...fingers].find(([id]) => id !== event.pointerId);
      if (other) {
        const apart = (p) => Math.hypot(p[0] - other[1][0], p[1] - other[1][1]) || 1;
        this.zoom(apart(now) / apart(before), (now[0] + other[1][0]) / 2, (now[1] + other[1][1]) / 2);
      }
      const share = other ? 0.5 : 1;
      this.view.east -= (share * (now[0] - before[0])) / this.view.scale;
      this.view.north += (share * (now[1] - before[1])) / this.view.scale;
      fingers.set(event.pointerId, now);
      this.touched = this.stale = true;
    });
    canvas.addEventListener("dblclick", () => {
      this.touched = false;
      this.fit();
    });
    canvas.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
      const move = step[event.key];
      if (event.key === "+" || event.key === "-")
        this.zoom(event.key === "+" ? 1.25 : 0.8, canvas.width / 2, canvas.height / 2);
      if (!move || !this.view) return;
      event.preventDefault();
      this.view.east += (move[0] * 60) / this.view.scale;
      this.view.north += (move[1] * 60) / this.view.scale;
      this.touched = this.stale = true;
    });
  }

  // --- drawing
  frame(now_ms) {
    const begin_ms = performance.now();
    const canvas = this.canvas;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.round(canvas.clientWidth * ratio);
    const height = Math.round(canvas.clientHeight * ratio);
    if (!this.scene || !width || !height) return;
    this.ratio = ratio;
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = this.base.width = width;
      canvas.height = this.base.height = height;
      if (!this.touched) this.view = null;
      this.stale = true;
    }
    if (!this.view || (this.stale && !this.touched)) this.fit();
    const glided = this.glide((now_ms - this.last_ms) / 1000);
    this.last_ms = now_ms;
    if (this.stale) this.drawBase();
    if (!this.stale && !glided) return;
    this.stale = false;
    this.pen.drawImage(this.base, 0, 0);
    this.drawPaths();
    this.drawVehicles();
    drawTraffic(this);
    this.frames += 1;
    this.drawn_ms += performance.now() - begin_ms;
  }

  glide(elapsed_s) {
    let moved = false;
    const share = 1 - Math.exp(-Math.max(elapsed_s, 0) / EASE_S);
    for (const [number, v] of Object.entries(this.board.vehicles)) {
      const at = this.shown[number];
      if (!at) {
        this.shown[number] = [v.e, v.n];
        moved = true;
      } else if (Math.abs(v.e - at[0]) + Math.abs(v.n - at[1]) > 0.02) {
        at[0] += (v.e - at[0]) * share;
        at[1] += (v.n - at[1]) * share;
        moved = true;
      }
    }
    return moved;
  }

  drawBase() {
    const pen = this.base.getContext("2d");
    const { view, scene } = this;
    pen.fillStyle = scene.land;
    pen.fillRect(0, 0, this.base.width, this.base.height);
    const [de, dn] = this.drifted();
    const ground = (e, n) => this.at(e - de, n - dn);
    for (const name of ["background", "mosaic"]) {
      if (!this[name]) continue;
      const { west, north, width_m, height_m } = scene[name];
      const [x, y] = ground(west, north);
      pen.drawImage(this[name], x, y, width_m * view.scale, height_m * view.scale);
    }
    this.drawCells(pen, this.background || this.mosaic ? 0.6 : 1);
    this.drawRing(pen, scene.box.map((p) => ground(...p)), scene.lines.box);
    for (const ring of [scene.fence, ...scene.holes])
      this.drawRing(pen, ring.map((p) => ground(...p)), scene.lines.fence);
    this.drawTracks(pen);
    const [x, y] = ground(...scene.home);
    for (const [radius, colour] of scene.home_mark) {
      pen.fillStyle = colour;
      pen.beginPath();
      pen.arc(x, y, radius * this.ratio, 0, 7);
      pen.fill();
    }
    this.drawScale(pen);
  }

  drawCells(pen, opacity) {
    const { raster, view } = this;
    const m = this.scene.cell_m;
    if (!raster.canvas) return;
    const [x, y] = this.at((raster.west - 0.5) * m, (raster.south + raster.rows - 0.5) * m);
    const px = m * view.scale;
    pen.globalAlpha = opacity;
    pen.imageSmoothingEnabled = false;
    pen.drawImage(raster.canvas, x, y, raster.columns * px, raster.rows * px);
    pen.imageSmoothingEnabled = true;
    pen.globalAlpha = 1;
    if (px < 7 * this.ratio) return;
    // the grid, over the search box and the seen cells
    const [de, dn] = this.drifted();
    const box = this.scene.box.map(([e, n]) => [(e - de) / m, (n - dn) / m]);
    const seen = raster.seen;
    const columns = [seen[0], seen[2], ...box.map((p) => p[0])];
    const rows = [seen[1], seen[3], ...box.map((p) => p[1])];
    const [west, east] = [Math.round(Math.min(...columns)), Math.round(Math.max(...columns))];
    const [south, north] = [Math.round(Math.min(...rows)), Math.round(Math.max(...rows))];
    const [left, top] = this.at((west - 0.5) * m, (north + 0.5) * m);
    const [right, low] = this.at((east + 0.5) * m, (south - 0.5) * m);
    pen.strokeStyle = "rgba(90,96,102,0.18)";
    pen.lineWidth = 1;
    pen.beginPath();
    for (let i = 0; i <= east - west + 1; i++) {
      const at = Math.round(left + i * px) + 0.5;
      if (at < 0 || at > this.base.width) continue;
      pen.moveTo(at, Math.max(top, 0));
      pen.lineTo(at, Math.min(low, this.base.height));
    }
    for (let j = 0; j <= north - south + 1; j++) {
      const at = Math.round(top + j * px) + 0.5;
      if (at < 0 || at > this.base.height) continue;
      pen.moveTo(Math.max(left, 0), at);
      pen.lineTo(Math.min(right, this.base.width), at);
    }
    pen.stroke();
  }

  drawRing(pen, ring, { colour, dash }) {
    if (!ring.length) return;
    pen.strokeStyle = colour;
    pen.lineWidth = 1.5 * this.ratio;
    pen.setLineDash([dash * this.ratio, dash * this.ratio]);
    pen.beginPath();
    ring.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.closePath();
    pen.stroke();
    pen.setLineDash([]);
  }

  colour(number) {
    const colours = this.scene.tracks;
    return colours[number % colours.length];
  }

  drawTracks(pen) {
    pen.lineWidth = 1.4 * this.ratio;
    pen.lineJoin = "bevel";
    for (const [number, points] of Object.entries(this.board.tracks)) {
      pen.strokeStyle = this.colour(number);
      pen.globalAlpha = 0.75;
      pen.beginPath();
      let last = null;
      for (let i = 0; i < points.length; i += 2) {
        const [x, y] = this.at(points[i], points[i + 1]);
        if (last && Math.abs(x - last[0]) + Math.abs(y - last[1]) < 1.5) continue;
        if (last) pen.lineTo(x, y);
        else pen.moveTo(x, y);
        last = [x, y];
      }
      pen.stroke();
    }
    pen.globalAlpha = 1;
  }

  drawScale(pen) {
    const longest = (130 * this.ratio) / this.view.scale;
    const power = 10 ** Math.floor(Math.log10(longest));
    const length = [5, 2, 1].map((f) => f * power).find((l) => l <= longest);
    const px = length * this.view.scale;
    const y = this.base.height - 14 * this.ratio;
    const x = 12 * this.ratio;
    pen.fillStyle = this.scene.ink;
    pen.fillRect(x, y, px, 3 * this.ratio);
    pen.font = 12 * this.ratio + "px system-ui, sans-serif";
    pen.textAlign = "left";
    pen.textBaseline = "bottom";
    pen.fillText(length + " m", x, y - 3 * this.ratio);
  }

  // from each marker along the present path of its vehicle; of points with a time only later ones
  drawPaths() {
    const { pen, ratio } = this;
    const now_s = this.board.fields.t_s || 0;
    pen.lineWidth = 1.6 * ratio;
    pen.lineJoin = "round";
    pen.setLineDash([2 * ratio, 4 * ratio]);
    for (const number of Object.keys(this.board.vehicles)) {
      const path = this.board.fields["path " + number];
      const at = this.shown[number];
      if (!at || !path || !path.length) continue;
      pen.strokeStyle = this.colour(number);
      pen.beginPath();
      pen.moveTo(...this.at(...at));
      for (let i = 0; i < path.length; i += 3)
        if (path[i] > now_s) pen.lineTo(...this.at(path[i + 1], path[i + 2]));
      pen.stroke();
    }
    pen.setLineDash([]);
  }

  drawVehicles() {
    const { pen, ratio } = this;
    const size = 8 * ratio;
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.font = "bold " + 10 * ratio + "px system-ui, sans-serif";
    for (const [number, v] of Object.entries(this.board.vehicles)) {
      const at = this.shown[number];
      if (!at) continue;
      const [x, y] = this.at(...at);
      pen.beginPath();
      pen.arc(x, y, size, 0, 7);
      pen.globalAlpha = v.phase === "offline" ? 0.4 : 1;
      pen.fillStyle = v.landed ? "#fff" : this.colour(number);
      pen.fill();
      pen.lineWidth = 2 * ratio;
      pen.strokeStyle = v.landed ? this.colour(number) : "#fff";
      pen.stroke();
      pen.fillStyle = v.landed ? this.scene.ink : inkOn(this.colour(number));
      pen.fillText(number, x, y);
      pen.globalAlpha = 1;
    }
  }
}
