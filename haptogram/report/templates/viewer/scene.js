// The scene: a header of JSON and columns of numbers, as haptogram/report/viewer/scene.py writes it.

const COLUMN_TYPES = { u1: Uint8Array, u4: Uint32Array, f4: Float32Array, f8: Float64Array };
const ALIGNMENT = 8;
const KEPT = 10000; // frames of a board that runs
const FRAME_COLUMNS = ["number", "status", "timing", "due_us", "latched_us", "margin_ms", "target_mm", "found_mm", "bound_mm",
  "across_mm", "along_mm", "pressure_pa", "force_mn", "seen", "phases", "amplitudes"];

async function unpackEmbedded(base64) {
  const bytes = Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
  const inflated = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return unpackScene(await new Response(inflated).arrayBuffer());
}

function unpackScene(buffer) {
  const magic = new TextDecoder().decode(new Uint8Array(buffer, 0, 4));
  if (magic !== "HGV1") throw new Error(`scene begins with ${magic}, must be HGV1`);
  const length = new DataView(buffer).getUint32(4, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, length)));
  let offset = aligned(8 + length);
  const columns = {};
  for (const [name, type, shape] of header.columns) {
    const size = shape.reduce((product, side) => product * side, 1);
    const column = new COLUMN_TYPES[type](buffer, offset, size);
    columns[name] = { values: column, width: shape.length > 1 ? shape[1] : 1, rows: shape[0] };
    offset = aligned(offset + column.byteLength);
  }
  return new Scene(header, columns);
}

function aligned(offset) {
  return Math.ceil(offset / ALIGNMENT) * ALIGNMENT;
}

class Scene {
  constructor(header, columns) {
    this.header = header;
    this.columns = columns;
    this.elements = columns.positions_mm.rows;
    this.startUs = this.frames ? this.timeOf(0) : 0;
  }

  // Take the frames of another scene behind these; return how many of the oldest are dropped for it.
  append(batch) {
    const dropped = Math.max(0, this.frames + batch.frames - KEPT);
    if (!this.frames) this.startUs = batch.startUs;
    this.#tellAmplitudes();
    batch.#tellAmplitudes();
    for (const name of FRAME_COLUMNS) {
      const [old, more] = [this.columns[name], batch.columns[name]];
      const kept = old.values.subarray(dropped * old.width);
      const values = new old.values.constructor(kept.length + more.values.length);
      values.set(kept);
      values.set(more.values, kept.length);
      this.columns[name] = { values, width: old.width, rows: values.length / old.width };
    }
    return dropped;
  }

  // Amplitudes that are said once become a row for each frame.
  #tellAmplitudes() {
    const { values, width, rows } = this.columns.amplitudes;
    if (rows === this.frames) return;
    const told = new Uint8Array(this.frames * width);
    for (let frame = 0; frame < this.frames; frame += 1) told.set(values, frame * width);
    this.columns.amplitudes = { values: told, width, rows: this.frames };
  }

  get frames() {
    return this.columns.number.rows;
  }

  column(name) {
    return this.columns[name].values;
  }

  // One row of a column, or null if the frame has none.
  row(name, frame) {
    const { values, width } = this.columns[name];
    const row = values.subarray(frame * width, (frame + 1) * width);
    return row.length && row.every((value) => !Number.isNaN(value)) ? row : null;
  }

  value(name, frame) {
    const row = this.row(name, frame);
    return row && row[0];
  }

  // Device time of a frame: when it latched, else when it was due, else that of the frame before.
  timeOf(frame) {
    const [due, latched] = [this.column("due_us"), this.column("latched_us")];
    for (let at = frame; at >= 0; at -= 1) {
      const time = Number.isNaN(latched[at]) ? due[at] : latched[at];
      if (!Number.isNaN(time)) return time;
    }
    return 0;
  }

  status(frame) {
    return this.header.statuses[this.column("status")[frame]];
  }

  // The frame whose drive is radiated: this one, or the last one before it that was seen.
  radiated(frame) {
    const seen = this.column("seen");
    while (frame >= 0 && !seen[frame]) frame -= 1;
    return frame;
  }

  phases(frame) {
    return this.column("phases").subarray(frame * this.elements, (frame + 1) * this.elements);
  }

  // Amplitudes that never change are said once.
  amplitudes(frame) {
    const { values, rows } = this.columns.amplitudes;
    const row = rows === this.frames ? frame : 0;
    return values.subarray(row * this.elements, (row + 1) * this.elements);
  }
}
