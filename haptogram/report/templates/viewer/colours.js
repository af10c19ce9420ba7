// Colour maps, as the pictures of the reports have them: stops in hexadecimal, linear between them.

const PHASE_STOPS = // cyclic: 0 and 2 pi look alike
  "e2d9e2d7d7ddc4ced4acc2cc95b5c781a6c37297c16887be6276ba5f64b55e51ad5d3da1592a8f511b7745135c3811452f14" +
  "363a113a4a13425f174a741e4f872750983550a64550b25652bb6958c27c63c89073cca389d1b6a3d8c7bedfd4d6e2d9e2";
const PRESSURE_STOPS =
  "00224e00285b002e6a0533711a386f273e6e32436d3b496c434e6c4b546c535a6d5a5f6e61656f686a716f70737676767d7c" +
  "788482798c8878938e789b9476a39a74aba072b4a76fbcae6cc4b468cdbb63d5c25edec958e7d150f0d846f9e03afee838";
const COLOURS = {}; // of the marks, by name: those of the style sheet in the theme that is shown

function takeColours(root) {
  const style = getComputedStyle(root);
  for (const name of ["target", "found", "good", "late", "open", "wrong", "lost", "margin"]) {
    COLOURS[name] = style.getPropertyValue(`--${name}`).trim();
  }
}

class ColourMap {
  constructor(stops) {
    this.stops = stops.match(/.{6}/g).map((hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16)));
    this.table = new Uint8Array(3 * 256);
    for (let step = 0; step < 256; step += 1) this.table.set(this.#between(step / 255), 3 * step);
    this.names = Array.from({ length: 256 }, (_, step) => this.#name(step));
  }

  #between(share) {
    const place = share * (this.stops.length - 1);
    const below = Math.min(Math.floor(place), this.stops.length - 2);
    return [0, 1, 2].map((channel) => {
      const [low, high] = [this.stops[below][channel], this.stops[below + 1][channel]];
      return Math.round(low + (place - below) * (high - low));
    });
  }

  #name(step) {
    return `rgb(${this.table.subarray(3 * step, 3 * step + 3).join(" ")})`;
  }

  get gradient() {
    return `linear-gradient(to right, ${this.stops.map((stop) => `rgb(${stop.join(" ")})`).join(", ")})`;
  }
}

const PHASE_MAP = new ColourMap(PHASE_STOPS);
const PRESSURE_MAP = new ColourMap(PRESSURE_STOPS);
