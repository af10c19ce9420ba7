// The picture in space: array, field on a plane, foci. An orthographic view, drawn from back to front:
// what lies behind the plane, the plane, what lies before it. It needs no graphics processor.

const DECIBELS = 40; // below the highest pressure that the scale shows
const TRAIL = 300; // foci before the shown one that are drawn
const FIRST_VIEW = { azimuth: -0.5, elevation: 0.45 }; // radians
const FILLED = 0.94; // of the picture, by what there is to see

class Camera {
  constructor() {
    this.reset();
  }

  // Turn to the middle of a box, as far away as its corners need in the first view.
  lookAt({ low, high }) {
    this.centre = low.map((value, axis) => (value + high[axis]) / 2);
    this.half = low.map((value, axis) => (high[axis] - value) / 2);
  }

  reset() {
    Object.assign(this, { ...FIRST_VIEW, zoom: 1 });
  }

  turn(azimuth, elevation) {
    this.azimuth += azimuth;
    this.elevation = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, this.elevation + elevation));
  }

  magnify(factor) {
    this.zoom = Math.max(0.2, Math.min(50, this.zoom * factor));
  }

  // Vectors to the right, up, and toward the viewer, for a picture of this size in pixels.
  view(width, height) {
    const first = axesOf(FIRST_VIEW);
    // Half of what the box takes up in each direction, seen as at first: it keeps its size when it turns.
    const [across, upward] = [first.right, first.up].map((axis) => dot(this.half, axis.map(Math.abs)));
    const scale = this.zoom * FILLED * Math.min(width / (2 * across), height / (2 * upward));
    return { ...axesOf(this), scale, width, height, centre: this.centre };
  }
}

function axesOf({ azimuth, elevation }) {
  const [ca, sa] = [Math.cos(azimuth), Math.sin(azimuth)];
  const [ce, se] = [Math.cos(elevation), Math.sin(elevation)];
  return { right: [ca, sa, 0], up: [-sa * se, ca * se, ce], toward: [sa * ce, -ca * ce, se] };
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Pixel of a point in mm.
function project(view, point) {
  const offset = [0, 1, 2].map((axis) => point[axis] - view.centre[axis]);
  return [
    view.width / 2 + view.scale * dot(offset, view.right),
    view.height / 2 - view.scale * dot(offset, view.up),
  ];
}

class Picture {
  constructor(canvas, scene) {
    Object.assign(this, { canvas, scene });
    this.field = new Field(scene);
    this.context = canvas.getContext("2d");
    this.bounds = boundsOf(scene);
    this.camera = new Camera();
    this.camera.lookAt(this.bounds);
    this.radiusMm = 0.45 * elementSpacing(scene);
    this.#scale();
    this.image = document.createElement("canvas");
    this.setPlane(2, null);
  }

  // Take in the frames that were appended; a focus beyond the bounds widens them.
  grow() {
    const { low, high } = boundsOf(this.scene);
    const wider = low.some((value, axis) => value < this.bounds.low[axis] || high[axis] > this.bounds.high[axis]);
    if (wider) {
      this.bounds = {
        low: low.map((value, axis) => Math.min(value, this.bounds.low[axis])),
        high: high.map((value, axis) => Math.max(value, this.bounds.high[axis])),
      };
      this.camera.lookAt(this.bounds);
      this.setPlane(this.plane.axis, this.plane.at, this.plane.side);
    }
    this.#scale();
    this.painted = null; // the frames have moved
  }

  // Put the plane at a coordinate (mm) of an axis (0 x, 1 y, 2 z); coarse while it moves.
  setPlane(axis, at, side = 72) {
    const { low, high } = this.bounds;
    const middle = axis === 2 ? 0.6 * high[2] + 0.4 * low[2] : (low[axis] + high[axis]) / 2;
    this.plane = new Plane(axis, at ?? middle, low, high, side);
    this.propagators = this.field.isKnown ? this.field.propagators(this.plane.points()) : null;
    this.painted = null;
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth, clientHeight } = this.canvas;
    const [width, height] = [clientWidth, clientHeight].map((side) => Math.round(side * ratio));
    if (this.canvas.width !== width) this.canvas.width = width;
    if (this.canvas.height !== height) this.canvas.height = height;
    this.ratio = ratio;
    this.view = this.camera.view(clientWidth, clientHeight);
  }

  draw(frame, { decibels, trail }) {
    this.resize();
    const context = this.context;
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.clearRect(0, 0, this.view.width, this.view.height);
    for (const before of [false, true]) {
      if (before) this.#drawPlane(frame, decibels);
      this.#drawElements(frame, before);
      if (trail) this.#drawTrail(frame, before);
    }
    this.#drawMarks(frame);
    this.#drawAxes();
  }

  #isBefore(point) {
    return (point[this.plane.axis] - this.plane.at) * this.view.toward[this.plane.axis] >= 0;
  }

  #drawElements(frame, before) {
    const { positions_mm, normals } = this.scene.columns;
    const shown = this.scene.radiated(frame);
    const { phase_steps, amplitude_steps } = this.scene.header;
    const phases = shown < 0 ? null : this.scene.phases(shown);
    const amplitudes = shown < 0 ? null : this.scene.amplitudes(shown);
    for (let n = 0; n < this.scene.elements; n += 1) {
      const place = positions_mm.values.subarray(3 * n, 3 * n + 3);
      if (this.#isBefore(place) !== before) continue;
      const level = amplitudes ? amplitudes[n] / amplitude_steps : 0;
      const step = phases ? Math.floor((256 * phases[n]) / phase_steps) : 0;
      this.#drawDisc(place, normals.values.subarray(3 * n, 3 * n + 3), level, PHASE_MAP.names[step]);
    }
  }

  #drawDisc(place, normal, level, colour) {
    const { context, view } = this;
    const [x, y] = project(view, place);
    const tilt = Math.atan2(-dot(normal, view.up), dot(normal, view.right)) + Math.PI / 2;
    const radius = this.radiusMm * view.scale;
    context.beginPath();
    context.ellipse(x, y, radius, radius * Math.abs(dot(normal, view.toward)), tilt, 0, 2 * Math.PI);
    context.globalAlpha = 0.12 + 0.88 * level;
    context.fillStyle = level > 0 ? colour : this.ink;
    context.fill();
    context.globalAlpha = 0.5;
    context.strokeStyle = this.ink;
    context.lineWidth = 0.5;
    context.stroke();
    context.globalAlpha = 1;
  }

  #drawPlane(frame, decibels) {
    if (!this.propagators) return;
    const shown = this.scene.radiated(frame);
    const key = `${shown} ${decibels}`;
    if (key !== this.painted) this.#paint(shown, decibels);
    this.painted = key;
    const { context, plane, view, ratio } = this;
    const [origin, across, up] = [[0, 0], [1, 0], [0, 1]].map(([a, u]) => project(view, plane.corner(a, u)));
    const steps = [across[0] - origin[0], across[1] - origin[1], up[0] - origin[0], up[1] - origin[1]];
    context.save();
    context.setTransform(...steps.map((step) => (ratio * step) / plane.side), ratio * origin[0], ratio * origin[1]);
    context.imageSmoothingEnabled = true;
    context.imageSmoothingQuality = "high";
    context.drawImage(this.image, 0, 0);
    context.restore();
  }

  #paint(frame, decibels) {
    const { side } = this.plane;
    this.image.width = side;
    this.image.height = side;
    const pixels = new ImageData(side, side);
    if (frame >= 0) {
      this.values = this.field.pressure(this.propagators, frame);
      if (!this.isScaled) this.#scaleTo(this.values);
      this.values.forEach((value, at) => {
        const share = Math.min(1, this.#share(value, decibels));
        const step = 3 * Math.round(255 * (share || 0));
        pixels.data.set(PRESSURE_MAP.table.subarray(step, step + 3), 4 * at);
        pixels.data[4 * at + 3] = Number.isNaN(value) ? 0 : 140 + 100 * share;
      });
    }
    this.image.getContext("2d").putImageData(pixels, 0, 0);
  }

  // The scale ends at the highest focus; where none is known, at the highest pressure that was drawn.
  #scale() {
    const found = this.scene.column("found_mm"); // a frame without a focus is no measure
    const highest = this.scene.column("pressure_pa").reduce(
      (most, value, frame) => (value > most && !Number.isNaN(found[3 * frame]) ? value : most), 0);
    this.isScaled = highest > 0;
    if (this.isScaled) this.scalePa = Math.max(this.scalePa ?? 0, twoDigits(highest));
    else this.scalePa ??= 1;
  }

  #scaleTo(values) {
    const highest = values.reduce((most, value) => (value > most ? value : most), 1);
    this.scalePa = Math.max(this.scalePa, twoDigits(highest));
  }

  #share(value, decibels) {
    const share = value / this.scalePa;
    return decibels ? Math.max(0, 1 + (20 * Math.log10(Math.max(share, 1e-9))) / DECIBELS) : share;
  }

  #drawTrail(frame, before) {
    const { context } = this;
    context.fillStyle = COLOURS.found;
    for (let other = Math.max(0, frame - TRAIL); other < frame; other += 1) {
      const place = this.scene.row("found_mm", other);
      if (!place || this.#isBefore(place) !== before) continue;
      const [x, y] = project(this.view, place);
      context.globalAlpha = 0.15 + 0.85 * (1 - (frame - other) / TRAIL);
      context.fillRect(x - 1, y - 1, 2, 2);
    }
    context.globalAlpha = 1;
  }

  #drawMarks(frame) {
    const target = this.scene.row("target_mm", frame);
    const found = this.scene.row("found_mm", frame);
    if (target && found) this.#line(project(this.view, target), project(this.view, found), COLOURS.target, 1.5);
    if (found) this.#drawBound(frame, found);
    if (target) this.#cross(project(this.view, target), 9, false, COLOURS.target);
    if (found) this.#cross(project(this.view, found), 4, true, COLOURS.found);
  }

  // The largest error that rounding can make, as a bar along each axis.
  #drawBound(frame, place) {
    const bound = this.scene.row("bound_mm", frame);
    for (let axis = 0; bound && axis < 3; axis += 1) {
      const ends = [-1, 1].map((sign) => place.map((value, at) => value + (at === axis ? sign * bound[axis] : 0)));
      this.#line(...ends.map((end) => project(this.view, end)), COLOURS.found, 1);
    }
  }

  #cross([x, y], size, oblique, colour) {
    const arms = oblique ? [[1, 1], [1, -1]] : [[1, 0], [0, 1]];
    for (const [width, tint] of [[4, "#fff"], [2, colour]]) {
      for (const [dx, dy] of arms) {
        this.#line([x - size * dx, y - size * dy], [x + size * dx, y + size * dy], tint, width);
      }
    }
  }

  #line(from, to, colour, width) {
    const { context } = this;
    context.beginPath();
    context.moveTo(...from);
    context.lineTo(...to);
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.stroke();
  }

  // Directions of the axes and a length, in the corner of the picture.
  #drawAxes() {
    const { context, view } = this;
    const corner = [34, view.height - 34];
    context.font = "12px system-ui, sans-serif";
    context.fillStyle = this.ink;
    ["x", "y", "z"].forEach((name, axis) => {
      const end = [corner[0] + 22 * view.right[axis], corner[1] - 22 * view.up[axis]];
      this.#line(corner, end, this.ink, 1.5);
      context.fillText(name, end[0] + 3, end[1] - 3);
    });
    const length = roundLength(80 / view.scale);
    const from = [80, view.height - 20];
    this.#line(from, [from[0] + length * view.scale, from[1]], this.ink, 2);
    context.fillText(`${length} mm`, from[0], from[1] - 6);
  }
}

// Low and high corner of what there is to see: elements, targets and foci, and some air around.
function boundsOf(scene) {
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  const widen = (values) => values.forEach((value, at) => {
    if (Number.isNaN(value)) return;
    low[at % 3] = Math.min(low[at % 3], value);
    high[at % 3] = Math.max(high[at % 3], value);
  });
  const [positions, normals] = [scene.column("positions_mm"), scene.column("normals")];
  const places = ["target_mm", "found_mm"].map((name) => scene.column(name));
  widen(positions);
  if (places.some((place) => place.some((value) => !Number.isNaN(value)))) places.forEach(widen);
  else { // no focus is known: as far before the array as it is wide
    const reach = Math.max(50, ...low.map((value, axis) => high[axis] - value));
    widen(positions.map((value, at) => value + reach * normals[at]));
  }
  const margin = 0.1 * Math.max(20, ...low.map((value, axis) => high[axis] - value));
  return { low: low.map((value) => value - margin), high: high.map((value) => value + margin) };
}

function elementSpacing(scene) {
  const places = scene.column("positions_mm");
  let least = Infinity;
  for (let n = 1; n < scene.elements; n += 1) {
    for (let other = 0; other < n; other += 1) {
      const offset = [0, 1, 2].map((axis) => places[3 * n + axis] - places[3 * other + axis]);
      least = Math.min(least, dot(offset, offset));
    }
  }
  return Number.isFinite(least) ? Math.sqrt(least) : 10;
}

// A length of scale with two digits, no shorter than a value.
function twoDigits(value) {
  const unit = 10 ** (Math.floor(Math.log10(value)) - 1);
  return Math.ceil(value / unit - 1e-9) * unit;
}

function roundLength(length) {
  const unit = 10 ** Math.floor(Math.log10(length));
  return unit * [5, 2, 1].find((factor) => factor * unit <= length);
}
