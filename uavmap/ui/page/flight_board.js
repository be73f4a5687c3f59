// The flight in a browser: the board, the cells as a picture, and marks of other aircraft.
// uavmap/ui/page/board.py describes a delta.

const MAX_LINES = 300;
const MAX_POINTS = 3000;

// --- the board: a copy of the one in Python ----------------------------------------------------
export class Board {
  constructor() {
    this.version = 0;
    this.cells = new Map();
    this.fields = {};
    this.vehicles = {};
    this.tracks = {};
    this.log = [];
  }

  // returns whether the delta follows this version
  apply(delta, changedCell) {
    if (delta.since !== 0 && delta.since !== this.version) return false;
    if (delta.since === 0) Object.assign(this, new Board());
    const flat = delta.cells;
    for (let i = 0; i < flat.length; i += 3) {
      this.cells.set(flat[i] + "," + flat[i + 1], flat[i + 2]);
      changedCell(flat[i], flat[i + 1], flat[i + 2]);
    }
    Object.assign(this.fields, delta.fields);
    Object.assign(this.vehicles, delta.vehicles);
    for (const [number, points] of Object.entries(delta.tracks)) {
      const track = (this.tracks[number] || []).concat(points);
      this.tracks[number] = track.slice(-2 * MAX_POINTS);
    }
    this.log = this.log.concat(delta.log).slice(-MAX_LINES);
    this.version = delta.v;
    return true;
  }
}

// --- cells: a picture with a pixel for each, drawn larger ---------------------------------------
export class Raster {
  constructor() {
    this.clear();
  }

  clear() {
    this.west = this.south = 0;
    this.columns = this.rows = 0;
    this.canvas = null;
    this.seen = null; // bounds of the cells: west, south, east, north, in cells
  }

  set(column, row, colour) {
    const seen = this.seen || [column, row, column, row];
    this.seen = [
      Math.min(seen[0], column),
      Math.min(seen[1], row),
      Math.max(seen[2], column),
      Math.max(seen[3], row),
    ];
    if (
      !this.canvas ||
      column < this.west ||
      row < this.south ||
      column >= this.west + this.columns ||
      row >= this.south + this.rows
    )
      this.grow(column, row);
    this.pen.fillStyle = colour;
    this.pen.fillRect(column - this.west, this.rows - 1 - (row - this.south), 1, 1);
  }

  grow(column, row) {
    const old = { canvas: this.canvas, west: this.west, south: this.south, rows: this.rows };
    const east = Math.max(column, this.canvas ? this.west + this.columns - 1 : column);
    const north = Math.max(row, this.canvas ? this.south + this.rows - 1 : row);
    this.west = Math.min(column, this.canvas ? this.west : column) - 16;
    this.south = Math.min(row, this.canvas ? this.south : row) - 16;
    this.columns = east + 17 - this.west;
    this.rows = north + 17 - this.south;
    this.canvas = document.createElement("canvas");
    this.canvas.width = this.columns;
    this.canvas.height = this.rows;
    this.pen = this.canvas.getContext("2d");
    if (old.canvas)
      this.pen.drawImage(
        old.canvas,
        old.west - this.west,
        this.rows - old.rows - (old.south - this.south),
      );
  }
}

// --- black or white, whichever is easier to read on a colour such as #d55e00 ----------------------
export function inkOn(colour) {
  const linear = (v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  const [r, g, b] = [1, 3, 5].map((at) => linear(parseInt(colour.slice(at, at + 2), 16) / 255));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b > 0.179 ? "#000" : "#fff";
}

// --- aircraft of others: a diamond with call sign and height; at the edge if it is farther away ----
export function drawTraffic(map) {
  const { pen, ratio, canvas } = map;
  const edge = 10 * ratio;
  pen.font = "bold " + 11 * ratio + "px system-ui, sans-serif";
  pen.textBaseline = "middle";
  for (const { name, e, n, up } of map.board.fields.traffic || []) {
    const [far_x, far_y] = map.at(e, n);
    const x = Math.min(Math.max(far_x, edge), canvas.width - edge);
    const y = Math.min(Math.max(far_y, edge), canvas.height - edge);
    const size = 7 * ratio;
    pen.beginPath();
    for (const [dx, dy] of [[0, -size], [size, 0], [0, size], [-size, 0]]) pen.lineTo(x + dx, y + dy);
    pen.closePath();
    pen.fillStyle = map.scene.traffic;
    pen.strokeStyle = "#fff";
    pen.lineWidth = 2 * ratio;
    pen.fill();
    pen.stroke();
    const left = x > canvas.width / 2;
    pen.textAlign = left ? "right" : "left";
    const text = name + (up === null ? "" : " " + up + " m");
    pen.strokeText(text, x + (left ? -1.5 : 1.5) * size, y);
    pen.fillText(text, x + (left ? -1.5 : 1.5) * size, y);
  }
}
