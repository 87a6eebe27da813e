// What is drawn of the robot at one time: backbone, disks, tendons, holes, loads, gravity, measured markers.

// Plasma (matplotlib) in ten stops; without the end that fades into the ground.
const PLASMA = [[13, 8, 135], [70, 3, 159], [114, 1, 168], [156, 23, 158], [189, 55, 134], [216, 87, 107], [237, 121, 83],
  [251, 159, 58], [253, 202, 38], [240, 249, 33]];
function heat(share, dark) {
  const x = 9 * (dark ? 0.22 + 0.78 * share : 0.86 * share), i = Math.min(8, Math.floor(x)), f = x - i;
  return PLASMA[i].map((c, j) => ((1 - f) * c + f * PLASMA[i + 1][j]) / 255);
}

const THEMES = {
  light: {
    backbone: [0.30, 0.36, 0.43], disk: [0.80, 0.83, 0.86], plate: [0.42, 0.47, 0.53], grid: [0.86, 0.88, 0.90], path: [0.66, 0.71, 0.76],
    stick: [1, 1, 1], pull: [0.84, 0.37, 0], release: [0, 0.45, 0.70], slack: [0.62, 0.65, 0.69], anchor: [0.12, 0.16, 0.2],
    force: [0.72, 0, 0.13], moment: [0.48, 0.12, 0.64], gravity: [0.36, 0.38, 0.42],
    measured: [0, 0.62, 0.42], declared: [0.84, 0.37, 0],
    tendons: ["#c2334a", "#007a88", "#c96f00", "#6a4c93", "#3f784c", "#8d6346", "#d65db1", "#2b59c3", "#7a9a2e", "#17202a", "#2aa5b8", "#7f7f7f"],
  },
  dark: {
    backbone: [0.72, 0.77, 0.83], disk: [0.36, 0.41, 0.47], plate: [0.50, 0.55, 0.61], grid: [0.20, 0.23, 0.27], path: [0.38, 0.44, 0.50],
    stick: [0.95, 0.96, 0.97], pull: [1, 0.56, 0.22], release: [0.36, 0.71, 0.95], slack: [0.50, 0.54, 0.58], anchor: [0.45, 0.85, 0.85],
    force: [1, 0.36, 0.42], moment: [0.78, 0.53, 0.95], gravity: [0.70, 0.73, 0.77],
    measured: [0.16, 0.80, 0.55], declared: [1, 0.62, 0.28],
    tendons: ["#f0798a", "#3fb8c9", "#f2b04a", "#b294dd", "#74b783", "#c89a78", "#f2a3dc", "#7f9ff0", "#c3dc7a", "#e6eaee", "#7fe0ee", "#a8a8a8"],
  },
};
const rgb = hex => [1, 3, 5].map(i => parseInt(hex.slice(i, i + 2), 16) / 255);

// A round number near x: 1, 2 or 5 times a power of ten.
function round125(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  return power * ([1, 2, 5].find(m => m * power >= 0.999 * x) ?? 10);
}

class Scene {
  constructor(motion) {
    this.motion = motion;
    this.size = Math.max(motion.length, 1e-9);
    const d = motion.disks, gaps = d.at.map((k, i) => motion.s[k] - (i ? motion.s[d.at[i - 1]] : 0));
    this.thickness = Math.max(d.thickness, Math.min(0.12 * d.radius, 0.25 * Math.min(...gaps, this.size)));
    this.gap = Math.min(...gaps, this.size);
    this.measure();
    this.cell = round125(this.size / 14);
  }

  // Sizes by which arrows are drawn: the largest of all load steps.
  measure() {
    const { motion } = this;
    const sizes = moment => Math.max(0, ...motion.loads.flat().filter(l => l.moment === moment).map(l => Math.hypot(...l.vector)));
    this.largest = { force: sizes(false), moment: sizes(true), gravity: Math.hypot(...motion.gravity) };
  }

  // Direction from which the bending of a load step is seen best: a little off the normal of its plane.
  bestTurn(step) {
    const [x, y] = this.motion.tip(step);
    return Math.hypot(x, y) < 0.02 * this.size ? -0.96 : Math.atan2(y, x) - Math.PI / 2 + 0.3;
  }

  // Points that a picture of all load steps has to contain: robot, plate, arrows, markers; some hundred of many.
  points() {
    const m = this.motion, r = 1.6 * m.disks.radius, found = [[-r, -r, 0], [r, r, 0], [r, -r, -0.05 * this.size], [-r, r, 0]];
    for (const values of [m.position, m.measured?.values ?? [], m.declared?.values ?? []]) {
      const every = 3 * Math.ceil(values.length / 6000);
      for (let i = 0; i + 2 < values.length; i += every) found.push([values[i], values[i + 1], values[i + 2]]);
    }
    m.labels.forEach((_, k) => found.push(m.tip(k)));
    for (const arrow of m.loads.flat()) found.push(add(arrow.at, this.arrow(arrow)));
    return found.filter(p => p.every(Number.isFinite));
  }

  arrow(load) {
    return times(0.2 * this.size / (load.moment ? this.largest.moment : this.largest.force), load.vector);
  }

  // Fill the batches of a surface for the motion's present time.
  fill(surface, look) {
    const { rod, wire, beam, cone, ball } = surface.batches, theme = THEMES[look.theme];
    surface.clear();
    // Thin parts keep some pixels of width, whatever the distance.
    this.pixel = look.pixel;
    this.hole = Math.max(0.13 * this.motion.disks.radius, Math.min(3.4 * look.pixel, 0.3 * this.gap));
    this.wire = Math.max(0.04 * this.motion.disks.radius, 1.15 * look.pixel);
    this.ground(rod, wire, theme);
    this.backbone(beam, ball, theme);
    this.disks(look.glass ? surface.glass : rod, theme, look.glass ? 0.3 : 1);
    this.tendons(wire, ball, look);
    if (look.holes) this.holes(ball, cone, theme);
    if (look.loads) this.loads(wire, cone, theme);
    if (look.markers && this.motion.measured) this.markers(wire, ball, theme);
    if (look.path) this.path(wire, theme);
  }

  ground(rod, wire, theme) {
    const cells = Math.ceil(0.45 * this.size / this.cell), end = cells * this.cell, r = 0.55 * this.pixel;
    for (let i = -cells; i <= cells; i++) {
      wire.line([i * this.cell, -end, 0], [i * this.cell, end, 0], r, r, theme.grid);
      wire.line([-end, i * this.cell, 0], [end, i * this.cell, 0], r, r, theme.grid);
    }
    const disk = this.motion.disks.radius;
    rod.line([0, 0, -Math.min(1.5 * this.thickness, 0.4 * disk)], [0, 0, 0], 1.6 * disk, 1.6 * disk, theme.plate);
  }

  // One bent rod from section to section: a cubic with the section's tangents.
  backbone(beam, ball, theme) {
    const m = this.motion;
    for (let i = 0; i + 1 < m.sections; i++) {
      const a = Array.from(m.p.subarray(3 * i, 3 * i + 3)), b = Array.from(m.p.subarray(3 * i + 3, 3 * i + 6));
      const h = m.s[i + 1] - m.s[i];
      beam.put(a, times(h, m.axis(i, 2)), b, times(h, m.axis(i + 1, 2)), m.axis(i, 0), m.axis(i + 1, 0),
        this.drawnRadius(i), this.drawnRadius(i + 1), theme.backbone);
    }
    const last = m.sections - 1, r = this.drawnRadius(last);
    this.ball(ball, m.point(last, [0, 0, 0]), r, theme.backbone);
  }

  drawnRadius(section) {
    return Math.max(this.motion.radius[section], 2 * this.pixel);
  }

  ball(batch, at, r, colour) {
    batch.line(add(at, [0, 0, -r]), add(at, [0, 0, r]), r, r, colour);
  }

  disks(batch, theme, alpha) {
    const m = this.motion, h = this.thickness / 2, r = m.disks.radius;
    for (const k of m.disks.at) batch.line(m.point(k, [0, 0, -h]), m.point(k, [0, 0, h]), r, r, [...theme.disk, alpha]);
  }

  tendonColour(j, look) {
    return rgb(THEMES[look.theme].tendons[j % THEMES[look.theme].tendons.length]);
  }

  tendons(wire, ball, look) {
    const m = this.motion, dark = look.theme === "dark";
    m.tendons.forEach((t, j) => {
      const colour = segment => look.byTension
        ? heat(m.largestTension ? m.tensionOf(t.first + segment) / m.largestTension : 0, dark) : this.tendonColour(j, look);
      let before = m.point(t.at[0], t.points[0]);
      const below = add(before, [0, 0, -0.05 * this.size]);
      wire.line(below, before, this.wire, this.wire, colour(0));
      for (let i = 1; i < t.at.length; i++) {
        const next = m.point(t.at[i], t.points[i]), c = colour(t.segments[i - 1]);
        wire.line(before, next, this.wire, this.wire, c);
        if (i + 1 < t.at.length) this.ball(ball, next, this.wire, c);
        before = next;
      }
    });
  }

  // Holes with their place, direction and state; those of the anchor are last.
  *holeList() {
    const m = this.motion;
    for (const t of m.tendons) {
      for (let i = 1; i < t.at.length; i++) {
        if (i + 1 < t.at.length && t.segments[i] === t.segments[i - 1]) continue; // within a bay
        const number = t.segments[i - 1], end = i + 1 === t.at.length;
        yield { tendon: t, number, section: t.at[i], at: m.point(t.at[i], t.points[i]), axis: m.axis(t.at[i], 2),
          segment: t.first + number, end, state: end ? "anchor" : m.stateOf(t.first + number) };
      }
    }
  }

  // A ball where the tendon sticks or is slack; a cone in the direction in which it slips; a block at the anchor.
  holes(ball, cone, theme) {
    const r = this.hole;
    for (const h of this.holeList()) {
      if (h.state === "pull" || h.state === "release") {
        const d = times(h.state === "pull" ? -1.5 * r : 1.5 * r, h.axis);
        cone.line(sub(h.at, d), add(h.at, d), 1.25 * r, 0, theme[h.state]);
      } else {
        this.ball(ball, h.at, h.state === "anchor" ? 1.15 * r : r, theme[h.state ?? "slack"]);
      }
    }
  }

  draw3dArrow(wire, cone, at, vector, colour, double) {
    const n = unit(vector), r = Math.max(0.003 * this.size, 1.6 * this.pixel), head = Math.min(0.045 * this.size, 0.5 * Math.hypot(...vector));
    const end = add(at, vector), neck = sub(end, times(head, n));
    wire.line(at, neck, r, r, colour);
    cone.line(neck, end, 2.8 * r, 0, colour);
    if (double) cone.line(sub(neck, times(head, n)), neck, 2.8 * r, 0, colour);
  }

  // Loads that act now; those of the nearest load step, moved with the section.
  loads(wire, cone, theme) {
    const m = this.motion;
    for (const load of m.loads[m.step]) {
      this.ellipsoid(wire, load, theme);
      if (Math.hypot(...this.arrow(load)) < 6 * this.pixel) continue;
      this.draw3dArrow(wire, cone, this.moved(load), this.arrow(load), load.moment ? theme.moment : theme.force, load.moment);
    }
  }

  // Three ellipses around the head of an estimated force's arrow, in its scale.
  ellipsoid(wire, load, theme) {
    const axes = load.ellipsoid.map(axis => this.arrow({ vector: axis })), r = 0.7 * this.pixel;
    const head = add(this.moved(load), this.arrow(load));
    for (const [a, b] of axes.length ? [[0, 1], [1, 2], [2, 0]] : []) {
      const at = k => add(head, add(times(Math.cos(k * Math.PI / 16), axes[a]), times(Math.sin(k * Math.PI / 16), axes[b])));
      for (let k = 0; k < 32; k++) wire.line(at(k), at(k + 1), r, r, theme.force);
    }
  }

  // Where a load acts now: between two steps its section is on the way.
  moved(load) {
    const m = this.motion;
    if (load.section === undefined) {
      let best = Infinity;
      for (let i = 0; i < m.sections; i++) {
        const j = 3 * (m.sections * m.step + i);
        const d = Math.hypot(m.position[j] - load.at[0], m.position[j + 1] - load.at[1], m.position[j + 2] - load.at[2]);
        if (d < best) { best = d; load.section = i; }
      }
    }
    return m.point(load.section, [0, 0, 0]);
  }

  // Measured markers of the nearest load step, and the backbone of the declared model.
  markers(wire, ball, theme) {
    const m = this.motion, [, count] = m.measured.shape, r = Math.max(0.006 * this.size, 5 * this.pixel);
    for (let i = 0; i < count; i++) {
      const at = m.measured.values.subarray(3 * (count * m.step + i), 3 * (count * m.step + i) + 3);
      if (!at.some(Number.isNaN)) this.ball(ball, Array.from(at), r, theme.measured);
    }
    const [, nodes] = m.declared.shape, thin = 1.1 * this.pixel;
    const node = i => Array.from(m.declared.values.subarray(3 * (nodes * m.step + i), 3 * (nodes * m.step + i) + 3));
    for (let i = 0; i + 1 < nodes; i++) {
      const [a, b] = [node(i), node(i + 1)];
      if (![...a, ...b].some(Number.isNaN)) wire.line(a, b, thin, thin, theme.declared);
    }
  }

  path(wire, theme) {
    const m = this.motion, r = 0.7 * this.pixel;
    for (let k = 1; k <= m.step; k++) wire.line(m.tip(k - 1), m.tip(k), r, r, theme.path);
  }
}
