// Plots beside the robot, as SVG: a layer that stays, and one that follows the load step.

const SVG = document.querySelector(".robot-view .still svg").namespaceURI;
function element(name, attributes = {}, text = "") {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text) made.textContent = text;
  return made;
}

// Round numbers from low to high, about so many.
function ticks(low, high, count) {
  const step = round125((high - low) / count), found = [];
  for (let x = Math.ceil(low / step - 1e-9) * step; x <= high + 1e-9 * step; x += step) found.push(Math.abs(x) < 1e-9 * step ? 0 : x);
  return found;
}
const short = x => String(+x.toPrecision(4)).replace("-", "\u2212");

// A size with its unit and an SI prefix.
function quantity(value, unit) {
  const [factor, prefix] = [[1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "\u00b5"], [1e-9, "n"]].find(([f]) => value >= f) ?? [1, ""];
  return `${+(value / factor).toPrecision(3)} ${prefix}${unit}`;
}

// One pair of axes. Colours come from the classes of the style sheet.
class Plot {
  constructor(host, label) {
    this.host = host;
    this.svg = element("svg", { role: "img", "aria-label": label });
    this.fixed = element("g");
    this.moving = element("g");
    this.svg.append(this.fixed, this.moving);
    host.append(this.svg);
  }

  // Clear both layers; ranges in data, titles of the axes. `equal`: the same scale in both directions.
  begin(xRange, yRange, xTitle, yTitle, equal = false) {
    const width = Math.max(this.host.clientWidth, 200), height = Math.max(this.host.clientHeight, 130);
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.area = { left: 46, right: width - 10, top: 8, bottom: height - 32 };
    const { left, right, top, bottom } = this.area;
    let [x, y] = [xRange, yRange].map(([low, high]) => {
      const gap = high - low || Math.abs(high) || 1;
      return [low - 0.04 * gap, high + 0.05 * gap];
    });
    if (equal) {
      const scale = Math.max((x[1] - x[0]) / (right - left), (y[1] - y[0]) / (bottom - top));
      [x, y] = [[x, right - left], [y, bottom - top]].map(([[low, high], pixels]) => {
        const middle = (low + high) / 2, half = scale * pixels / 2;
        return [middle - half, middle + half];
      });
    }
    this.range = { x, y };
    this.fixed.replaceChildren();
    this.moving.replaceChildren();
    for (const at of ticks(...x, Math.max(2, (right - left) / 75))) {
      this.fixed.append(element("line", { class: "grid", x1: this.x(at), x2: this.x(at), y1: top, y2: bottom }),
        element("text", { class: "tick", x: this.x(at), y: bottom + 13, "text-anchor": "middle" }, short(at)));
    }
    for (const at of ticks(...y, Math.max(2, (bottom - top) / 28))) {
      this.fixed.append(element("line", { class: "grid", x1: left, x2: right, y1: this.y(at), y2: this.y(at) }),
        element("text", { class: "tick", x: left - 5, y: this.y(at) + 3.5, "text-anchor": "end" }, short(at)));
    }
    this.fixed.append(element("text", { class: "axis", x: (left + right) / 2, y: height - 5, "text-anchor": "middle" }, xTitle),
      element("text", { class: "axis", x: -(top + bottom) / 2, y: 11, transform: "rotate(-90)", "text-anchor": "middle" }, yTitle));
  }

  x(value) { const { left, right } = this.area, [low, high] = this.range.x; return left + (value - low) / (high - low) * (right - left); }
  y(value) { const { top, bottom } = this.area, [low, high] = this.range.y; return bottom - (value - low) / (high - low) * (bottom - top); }

  line(layer, points, attributes) {
    const path = points.map(([a, b], i) => `${i ? "L" : "M"}${this.x(a).toFixed(1)} ${this.y(b).toFixed(1)}`).join("");
    if (path) this[layer].append(element("path", { fill: "none", d: path, ...attributes }));
  }

  // A marker: "circle", "up", "down", "cross" or "square".
  marker(layer, [a, b], kind, size, attributes) {
    const x = this.x(a), y = this.y(b), s = size;
    const paths = { up: `M${x} ${y - s}L${x + s} ${y + 0.8 * s}H${x - s}Z`, down: `M${x} ${y + s}L${x + s} ${y - 0.8 * s}H${x - s}Z`,
      cross: `M${x - s} ${y - s}L${x + s} ${y + s}M${x - s} ${y + s}L${x + s} ${y - s}`, square: `M${x - s} ${y - s}h${2 * s}v${2 * s}h${-2 * s}Z` };
    this[layer].append(kind === "circle" ? element("circle", { cx: x, cy: y, r: s, ...attributes }) : element("path", { d: paths[kind], ...attributes }));
  }
}

const extent = values => values.filter(Number.isFinite).reduce(([a, b], x) => [Math.min(a, x), Math.max(b, x)], [Infinity, -Infinity]);
const finite = ([a, b]) => a <= b ? [a, b] : [0, 1];

// The three plots of the panel.
class Plots {
  constructor(root, motion, go) {
    this.motion = motion;
    this.theme = "light";
    this.unit = motion.length < 5 ? { name: "mm", factor: 1e3 } : { name: "m", factor: 1 };
    const host = name => root.querySelector(`[data-plot="${name}"]`);
    this.path = new Plot(host("path"), "Path of the tip; the dot is the present load step");
    this.profile = new Plot(host("tension"), "Tension along the tendons in the present load step");
    this.response = new Plot(host("response"), "Response over input; the dot is the present load step");
    this.view = root.querySelector("[data-choice=view]");
    this.input = root.querySelector("[data-choice=input]");
    this.output = root.querySelector("[data-choice=output]");
    this.choices();
    for (const choice of [this.view, this.input, this.output]) choice.addEventListener("change", () => this.layout());
    for (const [plot, points] of [[this.path, () => this.pathPoints], [this.response, () => this.responsePoints]]) {
      plot.svg.classList.add("clickable");
      plot.svg.addEventListener("click", e => {
        const box = plot.svg.getBoundingClientRect(), gap = ([a, b]) => Math.hypot(plot.x(a) - e.clientX + box.left, plot.y(b) - e.clientY + box.top);
        const gaps = points().map(gap);
        go(gaps.indexOf(Math.min(...gaps)));
      });
    }
    new ResizeObserver(() => this.layout()).observe(host("path"));
  }

  // Fill the lists; start with the plane in which the tip moves most, and the input that changes most.
  choices() {
    const m = this.motion, u = this.unit;
    const option = (list, value, text) => { const o = document.createElement("option"); o.value = value; o.textContent = text; list.append(o); };
    const tips = m.labels.map((_, k) => m.tip(k)), spans = [0, 1, 2].map(i => { const [a, b] = extent(tips.map(t => t[i])); return b - a; });
    for (const [value, text] of [["02", "from the side, x z"], ["12", "from the side, y z"], ["01", "from above, x y"]]) option(this.view, value, text);
    this.view.value = spans[1] > 0.25 * spans[0] && spans[0] > 0.25 * spans[1] ? "01" : spans[1] > spans[0] ? "12" : "02";
    this.series();
    const spread = j => {
      const kind = m.byDisplacement[j] ? "displacement" : "tension", [low, high] = extent(this.inputs[`${kind} ${j}`].values);
      return { key: `${kind} ${j}`, share: (high - low) / (kind === "tension" ? m.largestTension || 1 : u.factor * m.length) };
    };
    const most = m.tendons.map((_, j) => spread(j)).reduce((a, b) => b.share > a.share ? b : a, { key: "step", share: 0 });
    for (const [key, { title }] of Object.entries(this.inputs)) option(this.input, key, title.replace(/ \[.*/, ""));
    this.input.value = most.key;
    for (const [key, { title }] of Object.entries(this.outputs)) option(this.output, key, title.replace(/ \[.*/, ""));
  }

  // Inputs and outputs of all load steps.
  series() {
    const m = this.motion, u = this.unit, tips = m.labels.map((_, k) => m.tip(k));
    const column = (values, j) => m.labels.map((_, k) => values[m.tendons.length * k + j]);
    this.inputs = { step: { title: "load step", values: m.steps } };
    m.tendons.forEach((t, j) => {
      const kinds = { tension: ["N", column(m.baseTension, j)], displacement: [u.name, column(m.displacement, j).map(x => u.factor * x)] };
      for (const kind of m.byDisplacement[j] ? ["displacement", "tension"] : ["tension", "displacement"]) {
        const [name, values] = kinds[kind];
        this.inputs[`${kind} ${j}`] = { title: `${kind} of ${t.name} [${name}]`, values };
      }
    });
    this.outputs = {
      bending: { title: "bending angle of the tip [deg]", axis: "bending angle [deg]", values: m.bending },
      offset: { title: `distance of the tip from the z axis [${u.name}]`, axis: `tip off the z axis [${u.name}]`, values: tips.map(t => u.factor * Math.hypot(t[0], t[1])) },
      ...Object.fromEntries(["x", "y", "z"].map((axis, i) => [axis, { title: `tip ${axis} [${u.name}]`, values: tips.map(t => u.factor * t[i]) }])),
    };
  }

  // Draw the layers that stay; after a change of size, theme or choice.
  layout() {
    const m = this.motion, u = this.unit, [i, j] = [...this.view.value].map(Number);
    const scaled = values => values.map(p => [u.factor * p[i], u.factor * p[j]]);
    this.pathPoints = scaled(m.labels.map((_, k) => m.tip(k)));
    const measured = this.measuredTips(m.measured), declared = this.declaredTips(m.declared);
    const all = [...this.pathPoints, ...scaled(measured), ...scaled(declared)];
    this.path.begin(finite(extent(all.map(p => p[0]))), finite(extent(all.map(p => p[1]))), `${"xyz"[i]} [${u.name}]`, `${"xyz"[j]} [${u.name}]`, true);
    this.path.line("fixed", this.pathPoints, { class: "pale" });
    this.path.line("fixed", scaled(declared).filter(p => p.every(Number.isFinite)), { class: "declared" });
    for (const p of scaled(measured)) if (p.every(Number.isFinite)) this.path.marker("fixed", p, "circle", 2.6, { class: "measured" });

    const input = this.inputs[this.input.value], output = this.outputs[this.output.value];
    this.responsePoints = input.values.map((x, k) => [x, output.values[k]]);
    this.response.begin(finite(extent(input.values)), finite(extent(output.values)), input.title, output.axis ?? output.title);
    this.response.line("fixed", this.responsePoints, { class: "pale" });

    const ends = m.tendons.map(t => m.s[t.at[t.at.length - 1]]);
    this.profile.begin([0, u.factor * Math.max(...ends, 1e-9)], [0, m.largestTension || 1], `arc length [${u.name}]`, "tension [N]");
    this.followed = null;
    this.follow();
  }

  // Measured and declared tips by step; empty without markers.
  measuredTips(found) {
    if (!found || !found.shape[1]) return [];
    const [steps, count] = found.shape, last = this.motion.markers.s.indexOf(Math.max(...this.motion.markers.s));
    return Array.from({ length: steps }, (_, k) => Array.from(found.values.subarray(3 * (count * k + last), 3 * (count * k + last) + 3)));
  }
  declaredTips(found) {
    if (!found || !found.shape[1]) return [];
    const [steps, count] = found.shape;
    return Array.from({ length: steps }, (_, k) => Array.from(found.values.subarray(3 * count * (k + 1) - 3, 3 * count * (k + 1))));
  }

  // Draw what depends on the load step.
  follow() {
    if (!this.pathPoints || this.followed === this.motion.time) return;
    const m = this.motion, { k, next, f } = m.mix;
    this.followed = m.time;
    for (const [plot, points] of [[this.path, this.pathPoints], [this.response, this.responsePoints]]) {
      const now = [0, 1].map(i => (1 - f) * points[k][i] + f * points[next][i]);
      plot.moving.replaceChildren();
      plot.line("moving", [...points.slice(0, k + 1), now], { class: "strong" });
      plot.marker("moving", now, "circle", 5, { class: "dot" });
    }
    this.profile.moving.replaceChildren();
    const kinds = { stick: "circle", pull: "down", release: "up", slack: "cross", anchor: "square" };
    m.tendons.forEach((t, j) => {
      const palette = THEMES[this.theme].tendons, colour = palette[j % palette.length], line = [], marks = [];
      for (let i = 1; i < t.at.length; i++) {
        const number = t.segments[i - 1], tension = m.tensionOf(t.first + number);
        line.push([this.unit.factor * m.s[t.at[i - 1]], tension], [this.unit.factor * m.s[t.at[i]], tension]);
        const state = m.stateOf(t.first + number);
        if (state && i + 1 < t.at.length && t.segments[i] !== number) {
          marks.push([[this.unit.factor * m.s[t.at[i]], (tension + m.tensionOf(t.first + t.segments[i])) / 2], state]);
        }
      }
      this.profile.line("moving", line, { stroke: colour, "stroke-width": 1.6 });
      for (const [at, state] of marks) {
        this.profile.marker("moving", at, kinds[state], 2.8, { stroke: colour, "stroke-width": 1.3, fill: state === "stick" ? "var(--ground)" : colour });
      }
    });
  }
}
