// The time line: a tick for each frame in the colour of its status, its arrival margin, the error of its focus.

class Timeline {
  constructor(canvas, scene) {
    Object.assign(this, { canvas, scene });
    this.context = canvas.getContext("2d");
    this.grow();
  }

  // Take in all frames that the scene holds now.
  grow() {
    const { scene } = this;
    let last = -Infinity; // a late frame may latch after the next one: the line never runs back
    this.times = Array.from({ length: scene.frames }, (_, frame) => {
      last = Math.max(last, scene.timeOf(frame));
      return last;
    });
    this.start = this.times[0] ?? 0;
    this.end = Math.max(this.times.at(-1) ?? 0, this.start + 1);
    this.limit = scene.column("across_mm").reduce((most, v) => (v > most ? v : most), 0) || 1;
    this.longest = scene.column("margin_ms").reduce((most, v) => (v > most ? v : most), 0);
  }

  x(t) {
    return 4 + ((t - this.start) / (this.end - this.start)) * (this.width - 8);
  }

  // The frame at a place of the canvas, in pixels.
  frameAt(x) {
    const t = this.start + ((x - 4) / (this.width - 8)) * (this.end - this.start);
    return this.frameBefore(t);
  }

  // The last frame at or before a time.
  frameBefore(t) {
    let [low, high] = [0, this.times.length - 1];
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (this.times[middle] <= t) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  draw(frame, ink) {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.width = width;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.#drawMargins(height);
    this.#drawErrors(height, ink);
    // Troubles last: one lost frame among thousands must show.
    for (const rank of [0, 1, 2]) this.#drawTicks(rank);
    this.#drawCursor(frame, height, ink);
  }

  // A bar for each frame: how long before its time it had arrived; none if it came too late.
  #drawMargins(height) {
    this.context.fillStyle = COLOURS.margin;
    this.context.globalAlpha = 0.5;
    const width = Math.max(1, Math.min(8, (this.width - 8) / this.times.length - 1));
    this.scene.column("margin_ms").forEach((margin, frame) => {
      if (!(margin > 0)) return;
      const length = (margin / this.longest) * (height - 30);
      this.context.fillRect(this.x(this.times[frame]) - width / 2, height - 4 - length, width, length);
    });
    this.context.globalAlpha = 1;
  }

  #drawErrors(height, ink) {
    this.context.fillStyle = ink;
    this.context.globalAlpha = 0.6;
    this.scene.column("across_mm").forEach((error, frame) => {
      if (Number.isNaN(error)) return;
      const y = height - 4 - (Math.min(error / this.limit, 1)) * (height - 30);
      this.context.fillRect(this.x(this.times[frame]) - 0.5, y - 0.5, 1.5, 1.5);
    });
    this.context.globalAlpha = 1;
  }

  #drawTicks(rank) {
    for (let frame = 0; frame < this.times.length; frame += 1) {
      const trouble = troubleOf(this.scene, frame);
      if (trouble.rank !== rank) continue;
      this.context.fillStyle = trouble.colour;
      this.context.fillRect(this.x(this.times[frame]) - (rank ? 1 : 0.5), 2, rank ? 2 : 1, rank ? 20 : 10);
    }
  }

  #drawCursor(frame, height, ink) {
    const x = this.x(this.times[frame]);
    this.context.fillStyle = ink;
    this.context.fillRect(x - 0.75, 0, 1.5, height);
  }
}

const RANKS = { "on target": [0, "good"], latched: [0, "open"], sent: [0, "open"],
  "not verified": [1, "open"], "held up": [1, "open"], cancelled: [1, "open"],
  lost: [2, "lost"] };

// How much attention a frame wants, and its colour: 0 none, 1 late or not judged, 2 wrong or lost.
function troubleOf(scene, frame) {
  const [rank, name] = RANKS[scene.status(frame)] ?? [2, "wrong"];
  const late = rank === 0 && scene.column("timing")[frame] > 0;
  return late ? { rank: 1, colour: COLOURS.late } : { rank, colour: COLOURS[name] };
}
