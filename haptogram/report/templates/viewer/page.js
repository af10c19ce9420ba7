// The page: joins scene, picture, time line, tables and controls.

const SPEEDS = [1, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001]; // of the device's time

class Viewer {
  constructor(root, scene, isLive) {
    Object.assign(this, { root, scene, isLive, frame: 0, playing: false, troubles: new Map() });
    this.picture = new Picture(this.part("picture"), scene);
    this.timeline = new Timeline(this.part("timeline"), scene);
    this.#fillControls();
    this.#fillLegends();
    this.#fillTroubles(0);
    this.#listen();
    this.#takeColours();
    const newest = isLive && this.part("newest").checked; // else what failed comes first
    this.show(newest ? scene.frames - 1 : this.firstTrouble ?? 0);
    root.dataset.ready = "true";
  }

  part(name) {
    return this.root.querySelector(`[data-part="${name}"]`);
  }

  // Take more frames of a board that runs; show the newest one, unless somebody looks at another.
  append(batch) {
    const { scene } = this;
    this.frame -= scene.append(batch);
    scene.header.counters = batch.header.counters;
    this.picture.grow();
    this.timeline.grow();
    this.#fillTroubles(scene.frames - batch.frames);
    this.#fillLegends();
    this.#limitPlane();
    this.part("timeline").setAttribute("aria-valuemax", scene.frames - 1);
    this.show(this.part("newest").checked ? scene.frames - 1 : this.frame);
  }

  // --- what is shown ---------------------------------------------------------------------------

  show(frame) {
    this.frame = Math.max(0, Math.min(this.scene.frames - 1, frame));
    if (this.part("follow").checked) this.#followFocus();
    this.#fillFrame();
    this.draw();
  }

  draw() {
    const options = { decibels: this.part("decibels").checked, trail: this.part("trail").checked };
    this.picture.draw(this.frame, options);
    this.#fillScale(); // a field that is drawn may be above it
    this.timeline.draw(this.frame, this.picture.ink);
    this.#placeHandle();
  }

  // Where a point (mm) is in the picture, in pixels of the page.
  pixelOf(point) {
    return project(this.picture.view, point);
  }

  movePlane(at, moving = false) {
    const { axis, at: before, side: fine } = this.picture.plane;
    const { low, high } = this.picture.bounds;
    const kept = Math.max(low[axis], Math.min(high[axis], at));
    const side = moving ? 36 : 72;
    if (kept !== before || side !== fine) this.picture.setPlane(axis, kept, side);
    this.part("at").value = kept;
    this.part("at-text").textContent = `${kept.toFixed(1)} mm`;
  }

  #followFocus() {
    const place = this.scene.row("found_mm", this.frame) ?? this.scene.row("target_mm", this.frame);
    const moving = this.playing || (this.isLive && this.part("newest").checked);
    if (place) this.movePlane(place[this.picture.plane.axis], moving);
  }

  #choosePlane(axis) {
    this.picture.setPlane(axis, null);
    this.#limitPlane();
    this.movePlane(this.picture.plane.at);
    this.show(this.frame);
  }

  // --- tables and legends ----------------------------------------------------------------------

  #fillFrame() {
    const { scene, frame } = this;
    if (!scene.frames) return; // a board that has radiated nothing yet
    const number = (name, digits, unit) => {
      const value = scene.value(name, frame);
      return value === null ? null : `${fixed(value, digits)} ${unit}`;
    };
    const placeText = (row) => `${row.map((value) => fixed(value, 2)).join(", ")} mm`;
    const place = (name) => {
      const row = scene.row(name, frame);
      return row && placeText([...row]);
    };
    // Our axes are rows @ theirs, so theirs are the products of the columns with ours.
    const clientPlace = (name) => {
      const [row, axes] = [scene.row(name, frame), scene.header.client_axes];
      return row && axes ? placeText([0, 1, 2].map((at) => [0, 1, 2].reduce((sum, n) => sum + axes[n][at] * row[n], 0))) : null;
    };
    const rows = { // what is not known has no row
      frame: `${scene.column("number")[frame]} (${frame + 1} of ${scene.frames})`,
      time: `${((scene.timeOf(frame) - scene.startUs) / 1000).toFixed(3)} ms`,
      status: this.#statusText(frame),
      "target x, y, z": place("target_mm"),
      "focus x, y, z": place("found_mm"),
      "in the client's axes": clientPlace("found_mm"),
      "arrival margin": number("margin_ms", 3, "ms"),
      "error across the beam": number("across_mm", 3, "mm"),
      "error along the beam": number("along_mm", 3, "mm"),
      "pressure at the focus": place("found_mm") && number("pressure_pa", 0, "Pa RMS"),
      force: number("force_mn", 2, "mN"),
    };
    fillTable(this.part("frame"), Object.entries(rows).filter(([, value]) => value !== null));
    this.part("text").textContent = scene.header.texts[scene.column("number")[frame]] ?? "";
    const slider = this.part("timeline");
    slider.setAttribute("aria-valuenow", frame);
    slider.setAttribute("aria-valuetext", `frame ${rows.frame}, ${rows.status}`);
  }

  // Count the frames from the first new one on that want attention, with a button for each kind of them.
  #fillTroubles(first) {
    const { scene, troubles } = this;
    for (let frame = first; frame < scene.frames; frame += 1) {
      if (troubleOf(scene, frame).rank === 0) continue;
      const kind = this.#statusText(frame);
      troubles.set(kind, (troubles.get(kind) ?? 0) + 1);
      this.firstTrouble ??= frame;
    }
    const count = [...troubles.values()].reduce((sum, of) => sum + of, 0);
    this.part("trouble-count").textContent = count || "none";
    this.part("troubles").replaceChildren(...Array.from(troubles, ([kind, of]) => {
      const button = document.createElement("button");
      button.textContent = `next of ${of}: ${kind}`;
      button.addEventListener("click", () => this.#showNext(kind));
      return button;
    }));
    fillTable(this.part("counters"), Object.entries(scene.header.counters));
  }

  #statusText(frame) {
    return this.scene.status(frame) + ["", ", late", ", early"][this.scene.column("timing")[frame]];
  }

  // Show the next frame of a kind; behind the last one follows the first.
  #showNext(kind) {
    const { frames } = this.scene;
    const after = Array.from({ length: frames }, (_, at) => (this.frame + 1 + at) % frames);
    this.#jump(after.find((frame) => this.#statusText(frame) === kind) ?? -1);
  }

  // Show the frame of this number, if there is one.
  showNumber(number) {
    this.#jump(this.scene.column("number").indexOf(number));
  }

  #jump(frame) {
    if (frame < 0) return; // it was so long ago that it is no longer kept
    this.#stopFollowing();
    this.show(frame);
  }

  #stopFollowing() {
    this.part("newest").checked = false;
    if (this.playing) this.play(false);
  }

  #fillLegends() {
    this.part("phase-bar").style.background = PHASE_MAP.gradient;
    this.part("pressure-bar").style.background = PRESSURE_MAP.gradient;
    this.part("no-field").hidden = this.picture.field.isKnown;
    this.part("margins").hidden = !this.timeline.longest;
    this.part("longest").textContent = `${this.timeline.longest.toPrecision(3)} ms`;
  }

  #fillScale() {
    const top = `${this.picture.scalePa} Pa RMS`;
    const [low, high] = this.part("decibels").checked ? [`−${DECIBELS} dB`, `0 dB, ${top}`] : ["0", top];
    const written = this.part("pressure-high");
    if (written.textContent === high) return; // as in nearly every draw
    written.textContent = high;
    this.part("pressure-low").textContent = low;
  }

  // --- controls ----------------------------------------------------------------------------------

  #fillControls() {
    const run = (this.timeline.end - this.timeline.start) / 1e6;
    const chosen = this.isLive ? 1 : SPEEDS.find((speed) => run / speed >= 8) ?? SPEEDS.at(-1);
    for (const speed of SPEEDS) {
      const option = new Option(speed === 1 ? "real time" : `${speed} of real time`, speed);
      option.selected = speed === chosen;
      this.part("speed").append(option);
    }
    this.part("timeline").setAttribute("aria-valuemax", this.scene.frames - 1);
    this.#choosePlaneControls();
  }

  #choosePlaneControls() {
    this.#limitPlane();
    this.movePlane(this.picture.plane.at);
  }

  #limitPlane() {
    const { axis } = this.picture.plane;
    const { low, high } = this.picture.bounds;
    Object.assign(this.part("at"), { min: low[axis], max: high[axis], step: 0.1 });
  }

  play(playing) {
    if (!this.scene.frames) return;
    this.playing = playing;
    if (playing) this.part("newest").checked = false;
    this.part("play").textContent = playing ? "Pause" : "Play";
    if (!playing) {
      this.show(this.frame); // a plane that moved while it played is sharp again
      return;
    }
    if (this.frame === this.scene.frames - 1) this.frame = 0;
    this.clock = { wall: performance.now(), device: this.timeline.times[this.frame] };
    requestAnimationFrame((now) => this.#tick(now));
  }

  #tick(now) {
    if (!this.playing) return;
    const speed = Number(this.part("speed").value);
    this.clock.device += 1000 * (now - this.clock.wall) * speed;
    this.clock.wall = now;
    const frame = this.timeline.frameBefore(this.clock.device);
    if (frame !== this.frame) this.show(frame);
    if (this.clock.device >= this.timeline.end) this.play(false);
    else requestAnimationFrame((next) => this.#tick(next));
  }

  step(frames) {
    this.#stopFollowing();
    this.show(this.frame + frames);
  }

  #listen() {
    const on = (name, event, act) => this.part(name).addEventListener(event, act);
    on("play", "click", () => this.play(!this.playing));
    on("back", "click", () => this.step(-1));
    on("forward", "click", () => this.step(1));
    on("axis", "change", (event) => this.#choosePlane(Number(event.target.value)));
    on("at", "input", () => this.#dropPlane(Number(this.part("at").value), true));
    on("at", "change", () => this.#dropPlane(Number(this.part("at").value), false));
    on("newest", "change", () => this.show(this.scene.frames - 1));
    on("follow", "change", () => this.show(this.frame));
    on("trail", "change", () => this.draw());
    on("decibels", "change", () => this.draw());
    on("reset", "click", () => { this.picture.camera.reset(); this.draw(); });
    this.#listenToPicture();
    this.#listenToTimeline();
    new ResizeObserver(() => this.draw()).observe(this.part("picture"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.#takeColours();
      this.draw();
    });
  }

  #dropPlane(at, moving) {
    this.part("follow").checked = false;
    this.movePlane(at, moving);
    this.draw();
  }

  #listenToPicture() {
    const canvas = this.part("picture");
    drag(canvas, (event) => {
      this.picture.camera.turn(-0.01 * event.movementX, 0.01 * event.movementY);
      this.draw();
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.picture.camera.magnify(Math.exp(-0.001 * event.deltaY));
      this.draw();
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => this.#turnByKey(event));
    drag(this.part("handle"), (event) => this.#dragPlane(event), () => this.movePlane(this.picture.plane.at));
  }

  #turnByKey(event) {
    const { camera } = this.picture;
    const acts = {
      ArrowLeft: () => camera.turn(0.1, 0), ArrowRight: () => camera.turn(-0.1, 0),
      ArrowUp: () => camera.turn(0, 0.1), ArrowDown: () => camera.turn(0, -0.1),
      "+": () => camera.magnify(1.2), "-": () => camera.magnify(1 / 1.2), 0: () => camera.reset(),
    };
    if (!acts[event.key]) return;
    event.preventDefault();
    acts[event.key]();
    this.draw();
  }

  // The handle moves along the axis of the plane: a pixel is the axis as it is seen.
  #dragPlane(event) {
    const { axis, at } = this.picture.plane;
    const { right, up, scale } = this.picture.view;
    const seen = [scale * right[axis], -scale * up[axis]];
    const length = seen[0] ** 2 + seen[1] ** 2;
    if (length < 1e-3 * scale ** 2) return; // seen along the axis
    const moved = (event.movementX * seen[0] + event.movementY * seen[1]) / length;
    this.#dropPlane(at + moved, true);
  }

  #placeHandle() {
    const [x, y] = this.pixelOf(this.picture.plane.corner(1, 1));
    const { width, height } = this.picture.view;
    const handle = this.part("handle");
    handle.style.left = `${Math.max(0, Math.min(width - 28, x - 14))}px`;
    handle.style.top = `${Math.max(0, Math.min(height - 28, y - 14))}px`;
  }

  #listenToTimeline() {
    const canvas = this.part("timeline");
    const scrub = (event) => {
      this.#stopFollowing();
      this.show(this.timeline.frameAt(event.clientX - canvas.getBoundingClientRect().left));
    };
    canvas.addEventListener("pointerdown", scrub);
    drag(canvas, scrub);
    this.root.addEventListener("keydown", (event) => this.#stepByKey(event));
  }

  #stepByKey(event) {
    const inPicture = event.target === this.part("picture");
    if (["INPUT", "SELECT"].includes(event.target.tagName) || (inPicture && event.key !== " ")) return;
    const page = Math.max(1, Math.round(this.scene.frames / 20));
    const acts = {
      ArrowLeft: () => this.step(-1), ArrowRight: () => this.step(1),
      PageUp: () => this.step(-page), PageDown: () => this.step(page),
      Home: () => this.step(-this.scene.frames), End: () => this.step(this.scene.frames),
    };
    if (event.key === " " && event.target.tagName !== "BUTTON") acts[" "] = () => this.play(!this.playing);
    if (!acts[event.key]) return;
    event.preventDefault();
    acts[event.key]();
  }

  #takeColours() {
    takeColours(this.root);
    this.picture.ink = getComputedStyle(this.root).color;
  }
}

// A number with so many digits; what is rounded to zero has no sign.
function fixed(value, digits) {
  return (Number(value.toFixed(digits)) + 0).toFixed(digits);
}

function fillTable(table, rows) {
  table.replaceChildren(...rows.map(([name, value]) => {
    const row = document.createElement("tr");
    const head = document.createElement("th");
    head.scope = "row";
    head.textContent = name;
    const cell = document.createElement("td");
    cell.textContent = value;
    row.append(head, cell);
    return row;
  }));
}

function drag(element, move, end = () => {}) {
  element.addEventListener("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    element.addEventListener("pointermove", move);
  });
  for (const name of ["pointerup", "pointercancel"]) {
    element.addEventListener(name, () => {
      element.removeEventListener("pointermove", move);
      end();
    });
  }
}
