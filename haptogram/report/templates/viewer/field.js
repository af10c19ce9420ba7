// The field: RMS pressure of a drive, p = |sum_n w_n h_n P1 D(cos theta_n) e^((jk - alpha) r_n) / r_n|.

const NEAREST_MM = 1; // nearer to an element the model of the field does not hold
const GRAZING = 1e-6; // cosine: rounding puts no point behind an element

class Field {
  constructor(scene) {
    this.scene = scene;
    const columns = scene.columns;
    this.positions = columns.positions_mm.values;
    this.normals = columns.normals.values;
    this.response = columns.response.values;
    this.gains = columns.gains.values;
    this.widthAxes = columns.width_axes.values; // of rectangles
    this.weights = new Float32Array(2 * scene.elements);
  }

  get isKnown() {
    return this.gains.length > 0 || this.widthAxes.length > 0;
  }

  // Pressure of each element at each of the points (x, y, z in mm), at full drive, in Pa.
  propagators(points) {
    const count = points.length / 3;
    const [real, imaginary] = [0, 1].map(() => new Float32Array(count * this.scene.elements));
    for (let point = 0; point < count; point += 1) {
      this.#propagate(points, point, real, imaginary);
    }
    return { real, imaginary, count };
  }

  #propagate(points, point, real, imaginary) {
    const { wavelength_mm, absorption_np_m, source_pa_m } = this.scene.header;
    const [x, y, z] = [points[3 * point], points[3 * point + 1], points[3 * point + 2]];
    const first = point * this.scene.elements;
    for (let n = 0; n < this.scene.elements; n += 1) {
      const dx = x - this.positions[3 * n];
      const dy = y - this.positions[3 * n + 1];
      const dz = z - this.positions[3 * n + 2];
      const distance = Math.sqrt(dx * dx + dy * dy + dz * dz);
      if (distance < NEAREST_MM) {
        real.fill(NaN, first, first + this.scene.elements);
        return;
      }
      const gain = this.#gainTowards(n, dx / distance, dy / distance, dz / distance);
      const metres = 1e-3 * distance;
      const level = (source_pa_m * gain * Math.exp(-absorption_np_m * metres)) / metres;
      const turns = distance / wavelength_mm;
      const phase = 2 * Math.PI * (turns - Math.round(turns));
      real[first + n] = level * Math.cos(phase);
      imaginary[first + n] = level * Math.sin(phase);
    }
  }

  // Directivity of an element in a direction, a unit vector.
  #gainTowards(element, x, y, z) {
    const at = 3 * element;
    const [nx, ny, nz] = [this.normals[at], this.normals[at + 1], this.normals[at + 2]];
    const cosine = x * nx + y * ny + z * nz;
    if (!this.widthAxes.length) return this.#gain(cosine);
    if (cosine < -GRAZING) return 0;
    const [wx, wy, wz] = [this.widthAxes[at], this.widthAxes[at + 1], this.widthAxes[at + 2]];
    const across = x * wx + y * wy + z * wz;
    const along = x * (ny * wz - nz * wy) + y * (nz * wx - nx * wz) + z * (nx * wy - ny * wx);
    const { sides_mm, wavelength_mm } = this.scene.header;
    return sinc((sides_mm[0] * across) / wavelength_mm) * sinc((sides_mm[1] * along) / wavelength_mm);
  }

  // Directivity at a cosine of the angle to the axis, from its table.
  #gain(cosine) {
    const lowest = this.scene.header.baffled ? 0 : -1;
    if (cosine < lowest) return cosine < lowest - GRAZING ? 0 : this.gains[0];
    const place = ((Math.min(cosine, 1) - lowest) / (1 - lowest)) * (this.gains.length - 1);
    const below = Math.min(Math.floor(place), this.gains.length - 2);
    return this.gains[below] + (place - below) * (this.gains[below + 1] - this.gains[below]);
  }

  // Weights A e^(j phi) h_n of the drive of a frame; a positive phase is a lag.
  #setWeights(frame) {
    const { phase_steps, amplitude_steps } = this.scene.header;
    const [phases, amplitudes] = [this.scene.phases(frame), this.scene.amplitudes(frame)];
    for (let n = 0; n < this.scene.elements; n += 1) {
      const phase = (2 * Math.PI * phases[n]) / phase_steps;
      const level = amplitudes[n] / amplitude_steps;
      const [re, im] = [level * Math.cos(phase), level * Math.sin(phase)];
      const [hr, hi] = [this.response[2 * n], this.response[2 * n + 1]];
      this.weights[2 * n] = re * hr - im * hi;
      this.weights[2 * n + 1] = re * hi + im * hr;
    }
  }

  // RMS pressure in Pa at the points of *propagators*; NaN inside an element.
  pressure(propagators, frame, result = new Float32Array(propagators.count)) {
    this.#setWeights(frame);
    const { real, imaginary, count } = propagators;
    const { weights } = this;
    const { elements } = this.scene;
    for (let point = 0; point < count; point += 1) {
      let re = 0; // no destructuring here: this is the loop that takes the time
      let im = 0;
      let at = point * elements;
      for (let n = 0; n < elements; n += 1, at += 1) {
        const wr = weights[2 * n];
        const wi = weights[2 * n + 1];
        re += real[at] * wr - imaginary[at] * wi;
        im += real[at] * wi + imaginary[at] * wr;
      }
      result[point] = Math.sqrt(re * re + im * im);
    }
    return result;
  }
}

// sin(pi x) / (pi x)
function sinc(x) {
  return x === 0 ? 1 : Math.sin(Math.PI * x) / (Math.PI * x);
}

// A square cut through space, normal to one axis, of side x side points.
class Plane {
  constructor(axis, at, low, high, side) {
    Object.assign(this, { axis, at, low, high, side });
    this.across = axis === 0 ? 1 : 0; // the coordinates that run across and up
    this.up = axis === 2 ? 1 : 2;
  }

  points() {
    const points = new Float64Array(3 * this.side * this.side);
    for (let row = 0, at = 0; row < this.side; row += 1) {
      for (let column = 0; column < this.side; column += 1, at += 3) {
        points[at + this.axis] = this.at;
        points[at + this.across] = this.#coordinate(this.across, column);
        points[at + this.up] = this.#coordinate(this.up, row);
      }
    }
    return points;
  }

  #coordinate(axis, step) {
    return this.low[axis] + ((step + 0.5) / this.side) * (this.high[axis] - this.low[axis]);
  }

  // A corner of the square: 0 or 1 across, 0 or 1 up.
  corner(across, up) {
    const corner = [0, 0, 0];
    corner[this.axis] = this.at;
    corner[this.across] = across ? this.high[this.across] : this.low[this.across];
    corner[this.up] = up ? this.high[this.up] : this.low[this.up];
    return corner;
  }
}
