// The data of the page: numbers from base64, and the robot at any time between two load steps.

const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));

// An array that was stored with 16 bits a number; {values, shape}, row by row. Missing values are NaN.
function restore(stored) {
  const levels = new Uint16Array(bytes(stored.data).buffer), n = stored.low.length;
  const values = new Float32Array(levels.length);
  for (let i = 0; i < levels.length; i++) {
    values[i] = levels[i] > 65534 ? NaN : stored.low[i % n] + stored.step[i % n] * levels[i];
  }
  return { values, shape: stored.shape };
}

// Robot over its load steps. `at(time)` sets the poses of the sections at a time, in steps from 0; between steps
// positions and tensions are linear, rotations follow the shorter arc.
class Motion {
  constructor(data) {
    Object.assign(this, data);
    this.count = data.steps.length;
    this.sections = data.s.length;
    for (const key of ["position", "rotation", "tension", "baseTension", "displacement"]) this[key] = restore(data[key]).values;
    this.state = data.state ? bytes(data.state) : null;
    this.segments = this.tendons.reduce((sum, t) => { t.first = sum; return sum + t.count; }, 0);
    this.largestTension = this.tension.reduce((a, b) => Math.max(a, b), 0);
    if (data.markers) {
      this.measured = restore(data.markers.measured);
      this.declared = restore(data.markers.declared);
    }
    this.p = new Float32Array(3 * this.sections);
    this.q = new Float32Array(4 * this.sections);
    this.axes = new Float32Array(9 * this.sections); // columns of the rotations: x, y and tangent of the sections
    this.at(0);
  }

  at(time) {
    const last = this.count - 1, k = Math.min(Math.floor(time), Math.max(last - 1, 0)), f = last ? time - k : 0;
    const next = Math.min(k + 1, last), n = this.sections;
    this.time = time;
    this.step = Math.round(time);
    const p = this.position, q = this.rotation;
    for (let i = 0, a = 3 * n * k, b = 3 * n * next; i < 3 * n; i++) this.p[i] = (1 - f) * p[a + i] + f * p[b + i];
    for (let i = 0; i < n; i++) {
      const a = 4 * (n * k + i), b = 4 * (n * next + i);
      const sign = q[a] * q[b] + q[a + 1] * q[b + 1] + q[a + 2] * q[b + 2] + q[a + 3] * q[b + 3] < 0 ? -f : f;
      let w = (1 - f) * q[a] + sign * q[b], x = (1 - f) * q[a + 1] + sign * q[b + 1];
      let y = (1 - f) * q[a + 2] + sign * q[b + 2], z = (1 - f) * q[a + 3] + sign * q[b + 3];
      const norm = 1 / Math.hypot(w, x, y, z);
      w *= norm; x *= norm; y *= norm; z *= norm;
      this.axes.set([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y),
        2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x),
        2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], 9 * i);
    }
    this.mix = { k, next, f };
  }

  // Add the load steps of another motion of the robot; of more than `most` the first are dropped.
  append(other, most) {
    const dropped = Math.max(0, this.count + other.count - most);
    for (const motion of [this, other]) motion.state ??= new Uint8Array(motion.segments * motion.count).fill(NO_FRICTION);
    const widths = { position: 3 * this.sections, rotation: 4 * this.sections, tension: this.segments, state: this.segments,
      baseTension: this.tendons.length, displacement: this.tendons.length };
    for (const [key, width] of Object.entries(widths)) {
      const before = this[key].subarray(width * dropped), joined = new before.constructor(before.length + other[key].length);
      joined.set(before);
      joined.set(other[key], before.length);
      this[key] = joined;
    }
    for (const key of ["steps", "labels", "loads", "bending"]) this[key] = [...this[key].slice(dropped), ...other[key]];
    this.count = this.steps.length;
    this.largestTension = Math.max(this.largestTension, other.largestTension);
  }

  // Forget all load steps.
  clear() {
    for (const key of ["position", "rotation", "tension", "state", "baseTension", "displacement"]) this[key] = this[key]?.subarray(0, 0);
    for (const key of ["steps", "labels", "loads", "bending"]) this[key] = [];
    this.count = this.largestTension = 0;
  }

  // Tension of a segment (numbered over all tendons), now.
  tensionOf(segment) {
    const { k, next, f } = this.mix, g = this.segments;
    return (1 - f) * this.tension[g * k + segment] + f * this.tension[g * next + segment];
  }

  // State of the hole at the far end of a segment in the nearest load step; null without friction.
  stateOf(segment) {
    return STATES[this.state?.[this.segments * this.step + segment]] ?? null;
  }

  // World position of a point of a section.
  point(section, local) {
    const r = this.axes, i = 9 * section, p = this.p, j = 3 * section, [x, y, z] = local;
    return [p[j] + r[i] * x + r[i + 3] * y + r[i + 6] * z, p[j + 1] + r[i + 1] * x + r[i + 4] * y + r[i + 7] * z,
      p[j + 2] + r[i + 2] * x + r[i + 5] * y + r[i + 8] * z];
  }

  axis(section, which) {
    const i = 9 * section + 3 * which;
    return [this.axes[i], this.axes[i + 1], this.axes[i + 2]];
  }

  tip(step) {
    const i = 3 * (this.sections * step + this.sections - 1);
    return [this.position[i], this.position[i + 1], this.position[i + 2]];
  }
}

const NO_FRICTION = 255; // in place of the index of a state
const STATES = ["stick", "pull", "release", "anchor", "slack"];
const STATE_TEXT = { stick: "sticks", pull: "slips, tendon pulled", release: "slips, tendon released", anchor: "anchor of a tendon", slack: "tendon slack" };
