// The panel: canvas, slider, buttons, mouse, keys. One for every element of class "robot-view" on the page.

class Panel {
  constructor(root) {
    this.root = root;
    this.motion = new Motion(JSON.parse(root.querySelector("script[type='application/json']").textContent));
    this.scene = new Scene(this.motion);
    this.find = selector => root.querySelector(selector);
    this.stage = this.find(".stage");
    this.over = this.find("canvas.over");
    this.slider = this.find("input[type=range]");
    this.camera = new Camera(this.scene.points(), this.scene.bestTurn(this.startStep()));
    this.look = { theme: "light", byTension: true, holes: true, loads: true, markers: true, glass: false, path: true };
    this.playing = false;
    try {
      this.surface = new Surface(this.find("canvas.gl"));
      root.classList.add("live");
    } catch (error) {
      this.surface = null;
      this.find(".still p").hidden = false;
    }
    this.plots = new Plots(root, this.motion, k => this.go(k));
    this.controls();
    this.keys();
    if (this.surface) this.mouse();
    this.resize();
    this.theme();
    new ResizeObserver(() => this.resize()).observe(this.stage);
    this.go(this.startStep());
    if (root.dataset.page === "whole") this.restore();
    this.draw();
  }

  // The step with the largest bending: more telling than the first, in which little acts.
  startStep() {
    return this.motion.bending.indexOf(Math.max(...this.motion.bending));
  }

  // ------------------------------------------------------------------------------------------------- state

  go(time) {
    this.motion.at(Math.max(0, Math.min(this.motion.count - 1, time)));
    const k = this.motion.step, label = this.motion.labels[k];
    this.slider.value = this.motion.time;
    const text = `step ${this.motion.steps[k]} of ${this.motion.steps[this.motion.count - 1]}${label ? ": " + label : ""}`;
    if (this.find("output").textContent !== text) {
      this.find("output").textContent = text;
      this.slider.setAttribute("aria-valuetext", text);
    }
    this.dirty();
  }

  // The motion has further load steps; show the last of them.
  grown() {
    this.slider.max = this.motion.count - 1;
    this.scene.measure();
    this.plots.series();
    this.legend();
    this.motion.at(this.motion.count - 1);
    this.plots.layout();
    this.go(this.motion.count - 1);
  }

  play(on = !this.playing) {
    this.playing = on && this.motion.count > 1;
    if (this.playing && this.motion.time >= this.motion.count - 1) this.go(0);
    const button = this.find("[data-do=play]");
    button.textContent = this.playing ? "\u275A\u275A" : "\u25B6";
    button.setAttribute("aria-label", this.playing ? "Pause" : "Play the load steps");
    if (!this.playing) this.go(this.motion.step);
    this.last = null;
    this.dirty();
  }

  // Load steps a second: all of them in some 6 to 20 seconds.
  speed() {
    return Math.max(1.2, Math.min(12, this.motion.count / 8)) * +this.find("[data-choice=speed]").value;
  }

  advance(now) {
    const seconds = this.last === null ? 0 : Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    const time = this.motion.time + seconds * this.speed(), end = this.motion.count - 1;
    // Without motion, where the reader's system asks for that, the robot goes from step to step.
    this.exact = this.exact === undefined || Math.abs(this.exact - this.motion.time) > 1 ? time : this.exact + seconds * this.speed();
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) this.go(Math.floor(this.exact)); else this.go(time);
    if ((matchMedia("(prefers-reduced-motion: reduce)").matches ? this.exact : time) >= end) this.play(false);
  }

  // ------------------------------------------------------------------------------------------------ drawing

  dirty() {
    this.waiting ??= requestAnimationFrame(now => {
      this.waiting = null;
      if (this.playing) this.advance(now);
      this.draw();
    });
  }

  draw() {
    this.plots.follow();
    if (!this.surface) return;
    this.look.pixel = this.camera.pixel(this.size[1]);
    this.scene.fill(this.surface, this.look);
    this.surface.draw(this.camera);
    this.overlay();
    this.drawOver?.(this.over.getContext("2d"));
  }

  resize() {
    const width = Math.max(1, this.stage.clientWidth), height = Math.max(1, this.stage.clientHeight), sharp = Math.min(2, devicePixelRatio || 1);
    for (const canvas of this.stage.querySelectorAll("canvas")) {
      canvas.width = Math.round(width * sharp);
      canvas.height = Math.round(height * sharp);
    }
    this.size = [width, height, sharp];
    this.camera.aspect = width / height;
    if (!this.moved) this.camera.fit();
    this.camera.update();
    this.dirty();
  }

  project(point) { return this.camera.project(point, this.size[0], this.size[1]); }

  // Texts, and the directions of the axes in the corner.
  overlay() {
    const pen = this.over.getContext("2d"), [width, height, sharp] = this.size;
    pen.setTransform(sharp, 0, 0, sharp, 0, 0);
    pen.clearRect(0, 0, width, height);
    const style = getComputedStyle(this.root), ink = style.color, ground = style.backgroundColor;
    pen.font = "12px " + style.fontFamily;
    pen.lineJoin = "round";
    const write = (text, x, y, colour = ink) => {
      pen.strokeStyle = ground; pen.lineWidth = 3; pen.strokeText(text, x, y);
      pen.fillStyle = colour; pen.fillText(text, x, y);
    };
    const corner = [38, height - 36], { camera } = this;
    for (const [name, axis, colour] of [["x", [1, 0, 0], "#c9473f"], ["y", [0, 1, 0], "#3f9143"], ["z", [0, 0, 1], "#3d74c9"]]) {
      const end = [corner[0] + 24 * dot(axis, camera.right), corner[1] - 24 * dot(axis, camera.up)];
      pen.strokeStyle = colour; pen.lineWidth = 2;
      pen.beginPath(); pen.moveTo(...corner); pen.lineTo(...end); pen.stroke();
      write(name, end[0] + (end[0] - corner[0]) * 0.3 - 3, end[1] + (end[1] - corner[1]) * 0.3 + 4, colour);
    }
    if (this.look.markers && this.motion.measured) this.rings(pen);
    if (!this.look.loads) return;
    const css = colour => `rgb(${colour.map(x => Math.round(255 * x)).join(" ")})`, colours = THEMES[this.look.theme];
    const loads = this.motion.loads[this.motion.step], size = load => Math.hypot(...load.vector);
    // Of many loads only the largest of each kind has its size beside it.
    const few = loads.length <= 4 ? loads : [false, true].flatMap(moment => loads.filter(l => l.moment === moment).sort((a, b) => size(b) - size(a)).slice(0, 1));
    for (const load of few) {
      const foot = this.scene.moved(load), at = this.project(add(foot, times(1.05, this.scene.arrow(load)))), from = this.project(foot);
      const text = `${load.name}: ${quantity(size(load), load.moment ? "N m" : "N")}`, room = this.size[0] - pen.measureText(text).width - 8;
      // Beside the head; where there is no room, on the side to which the arrow points, clear of it.
      const shift = !at || at[0] + 6 <= room ? -4 : from && at[1] > from[1] ? 20 : -14;
      if (at) write(text, Math.min(at[0] + 6, room), at[1] + shift, css(load.moment ? colours.moment : colours.force));
    }
    if (this.scene.largest.gravity) this.gravity(pen, write, css(colours.gravity));
  }

  // Measured markers again as rings, so that the robot does not hide them.
  rings(pen) {
    const { values, shape: [, count] } = this.motion.measured, colour = THEMES[this.look.theme].measured;
    pen.strokeStyle = `rgb(${colour.map(x => Math.round(255 * x)).join(" ")})`;
    pen.lineWidth = 1.8;
    for (let i = 0; i < count; i++) {
      const at = Array.from(values.subarray(3 * (count * this.motion.step + i), 3 * (count * this.motion.step + i) + 3));
      const place = at.some(Number.isNaN) ? null : this.project(at);
      if (place) { pen.beginPath(); pen.arc(place[0], place[1], 7, 0, 7); pen.stroke(); }
    }
  }

  // Direction of gravity in the corner, as a circle where it points at or away from the reader.
  gravity(pen, write, colour) {
    const g = unit(this.motion.gravity), x = this.size[0] - 48, y = this.size[1] - 52;
    const dx = 26 * dot(g, this.camera.right), dy = -26 * dot(g, this.camera.up), size = Math.hypot(dx, dy);
    pen.strokeStyle = pen.fillStyle = colour;
    pen.lineWidth = 2;
    pen.beginPath();
    if (size < 6) {
      pen.arc(x, y, 6, 0, 7);
    } else {
      const [ux, uy] = [dx / size, dy / size], ex = x + dx / 2, ey = y + dy / 2;
      pen.moveTo(x - dx / 2, y - dy / 2); pen.lineTo(ex, ey);
      pen.moveTo(ex - 7 * ux + 4 * uy, ey - 7 * uy - 4 * ux); pen.lineTo(ex, ey); pen.lineTo(ex - 7 * ux - 4 * uy, ey - 7 * uy + 4 * ux);
    }
    pen.stroke();
    const text = `g ${short(this.scene.largest.gravity)} m/s\u00b2`;
    write(text, Math.min(x - pen.measureText(text).width / 2, this.size[0] - pen.measureText(text).width - 8), y + 34, colour);
  }

  theme() {
    const dark = document.documentElement.classList.contains("dark");
    this.look.theme = this.plots.theme = dark ? "dark" : "light";
    const stops = Array.from({ length: 9 }, (_, i) => heat(i / 8, dark).map(x => Math.round(255 * x)));
    this.find(".heat").style.background = `linear-gradient(to right, ${stops.map(c => `rgb(${c.join(" ")})`).join(", ")})`;
    this.legend();
    this.plots.layout();
    this.dirty();
  }

  // Meaning of the colours in the picture and the plots.
  legend() {
    const m = this.motion, theme = THEMES[this.look.theme], css = c => `rgb(${c.map(x => Math.round(255 * x)).join(" ")})`;
    const list = this.find(".marks"), items = [];
    const item = (shape, colour, text) => items.push([shape, css(colour), text]);
    this.find(".scale").hidden = !this.look.byTension || !m.tendons.length;
    this.find(".scale b").textContent = `${short(m.largestTension)} N`;
    if (m.state && this.look.holes) {
      const seen = new Set(m.state);
      STATES.forEach((state, i) => { if (seen.has(i) && state !== "anchor") item({ pull: "down", release: "up" }[state] ?? "ball", theme[state], state === "slack" ? STATE_TEXT.slack : `hole ${STATE_TEXT[state]}`); });
    }
    if (this.look.holes && m.tendons.length) item("ball", theme.anchor, STATE_TEXT.anchor);
    if (this.look.loads && this.scene.largest.force) item("rod", theme.force, "force");
    if (this.look.loads && this.scene.largest.moment) item("rod", theme.moment, "moment (two heads)");
    if (this.look.loads && this.scene.largest.gravity) item("rod", theme.gravity, "gravity");
    if (this.look.markers && m.measured?.shape[1]) item("ball", theme.measured, "measured");
    if (this.look.markers && m.declared?.shape[1]) item("rod", theme.declared, "declared model");
    items.push(["square", css(theme.grid), `grid ${short(this.plots.unit.factor * this.scene.cell)} ${this.plots.unit.name}`]);
    list.replaceChildren(...items.map(([shape, colour, text]) => {
      const li = document.createElement("li"), mark = document.createElement("i");
      mark.className = shape;
      mark.style.setProperty("--c", colour);
      li.append(mark, text);
      return li;
    }));
    this.find(".names").replaceChildren(...(m.tendons.length <= 12 ? m.tendons : []).map((t, j) => {
      const li = document.createElement("li"), mark = document.createElement("i");
      mark.className = "rod";
      mark.style.setProperty("--c", theme.tendons[j % theme.tendons.length]);
      li.append(mark, t.name);
      return li;
    }));
  }

  // --------------------------------------------------------------------------------------------------- input

  controls() {
    this.slider.max = this.motion.count - 1;
    this.slider.addEventListener("input", () => { this.playing && this.play(false); this.go(+this.slider.value); });
    const actions = { play: () => this.play(), first: () => this.go(0), last: () => this.go(this.motion.count - 1),
      reset: () => this.reset(), x: () => this.turnTo(0, 0), y: () => this.turnTo(-Math.PI / 2, 0), z: () => this.turnTo(-Math.PI / 2, 1.55),
      save: () => this.save(), link: () => this.link() };
    for (const button of this.root.querySelectorAll("button[data-do]")) {
      button.addEventListener("click", () => { this.playing && button.dataset.do !== "play" && "first last".includes(button.dataset.do) && this.play(false); actions[button.dataset.do](); });
    }
    for (const box of this.root.querySelectorAll("input[type=checkbox]")) {
      box.checked = this.look[box.dataset.show];
      box.addEventListener("change", () => { this.look[box.dataset.show] = box.checked; this.legend(); this.dirty(); });
    }
    addEventListener("theme", () => this.theme());
    if (!this.motion.measured) this.find("[data-show=markers]").parentElement.remove();
    if (!this.motion.state) this.find("[data-show=holes]").parentElement.remove();
    if (!this.motion.tendons.length) {
      this.find("[data-plot=tension]").parentElement.hidden = true;
      this.find("[data-show=byTension]").parentElement.remove();
    }
    if (this.motion.count < this.motion.stepsInAll) {
      this.find(".note").textContent += ` ${this.motion.count} of ${this.motion.stepsInAll} load steps are shown.`;
    }
  }

  // The picture as it is seen, under the name of the robot.
  save() {
    const made = document.createElement("canvas"), pen = made.getContext("2d"), [gl, over] = ["gl", "over"].map(name => this.find(`canvas.${name}`));
    [made.width, made.height] = [gl.width, gl.height];
    pen.fillStyle = getComputedStyle(this.root).backgroundColor;
    pen.fillRect(0, 0, made.width, made.height);
    this.draw(); // what WebGL has drawn is there until the browser shows it
    for (const canvas of [gl, over]) pen.drawImage(canvas, 0, 0);
    const link = document.createElement("a");
    [link.href, link.download] = [made.toDataURL(), `${this.motion.name}_step_${this.motion.steps[this.motion.step]}.png`];
    link.click();
  }

  // The address of the page with load step and camera, which `restore` reads; copied where the browser allows it.
  link() {
    const { turn, lift, distance, target } = this.camera;
    location.hash = "view=" + [this.motion.step, turn, lift, distance, ...target].map(x => +x.toPrecision(6)).join(",");
    navigator.clipboard?.writeText(location.href).catch(() => {});
  }

  restore() {
    const numbers = (location.hash.match(/^#view=(.*)/)?.[1] ?? "").split(",").map(Number);
    if (numbers.length !== 7 || !numbers.every(Number.isFinite)) return;
    const [step, turn, lift, distance, ...target] = numbers;
    Object.assign(this.camera, { turn, lift, target });
    this.change(() => this.camera.update(distance));
    this.go(step);
  }

  reset() { this.moved = false; this.camera.reset(); this.dirty(); }

  turnTo(turn, lift) { this.camera.turn = turn; this.camera.lift = lift; this.moved = false; this.camera.fit(); this.dirty(); }

  change(action) { this.moved = true; action(); this.dirty(); }

  keys() {
    const step = by => { this.playing && this.play(false); this.go(this.motion.step + by); };
    const actions = { ArrowRight: () => step(1), ArrowLeft: () => step(-1), Home: () => step(-Infinity), End: () => step(Infinity),
      PageDown: () => step(10), PageUp: () => step(-10), " ": () => this.play(), 0: () => this.reset(),
      "+": () => this.change(() => this.camera.zoom(0.85)), "-": () => this.change(() => this.camera.zoom(1 / 0.85)),
      ArrowUp: () => this.change(() => this.camera.orbit(0, 0.08)), ArrowDown: () => this.change(() => this.camera.orbit(0, -0.08)) };
    const turns = { ArrowRight: [-0.1, 0], ArrowLeft: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
    const listen = this.root.dataset.page === "whole" ? document : this.root;
    listen.addEventListener("keydown", e => {
      if (e.ctrlKey || e.metaKey || e.altKey) return;
      if (e.target.closest("select, summary, a, input:not([type=checkbox])") && e.target !== this.slider) return;
      if (e.key === " " && e.target.closest("button, input[type=checkbox]")) return;
      if (e.target === this.slider && e.key.startsWith("Arrow") && !e.key.match(/Left|Right/)) return;
      if (e.shiftKey && turns[e.key]) this.change(() => this.camera.orbit(...turns[e.key]));
      else if (actions[e.key]) actions[e.key]();
      else return;
      e.preventDefault();
    });
  }

  // Drag turns, with the right or middle button or Shift it moves; the wheel and two fingers zoom; a double click resets.
  mouse() {
    const held = new Map(), stage = this.stage;
    const spread = () => { const [a, b] = [...held.values()]; return [Math.hypot(a[0] - b[0], a[1] - b[1]), (a[0] + b[0]) / 2, (a[1] + b[1]) / 2]; };
    stage.addEventListener("pointerdown", e => {
      if (e.target.closest("button, label, .still p")) return;
      stage.setPointerCapture(e.pointerId);
      held.set(e.pointerId, [e.clientX, e.clientY]);
      stage.classList.add("held");
      this.hover(e);  // a finger cannot hover
    });
    const release = e => { held.delete(e.pointerId); if (!held.size) stage.classList.remove("held"); };
    for (const name of ["pointerup", "pointercancel"]) stage.addEventListener(name, release);
    stage.addEventListener("pointermove", e => {
      if (!held.has(e.pointerId)) return this.hover(e);
      const [x, y] = held.get(e.pointerId), dx = e.clientX - x, dy = e.clientY - y;
      if (dx || dy) this.find(".tip").hidden = true;
      if (held.size === 2) {
        const before = spread();
        held.set(e.pointerId, [e.clientX, e.clientY]);
        const after = spread();
        this.change(() => { this.camera.zoom(before[0] / Math.max(after[0], 1)); this.camera.pan(after[1] - before[1], after[2] - before[2], this.size[1]); });
        return;
      }
      held.set(e.pointerId, [e.clientX, e.clientY]);
      if (e.buttons & 6 || e.shiftKey) this.change(() => this.camera.pan(dx, dy, this.size[1]));
      else this.change(() => this.camera.orbit(0.008 * dx, 0.008 * dy));
    });
    stage.addEventListener("wheel", e => {
      const box = stage.getBoundingClientRect();
      e.preventDefault();
      const x = 2 * (e.clientX - box.left) / box.width - 1, y = 1 - 2 * (e.clientY - box.top) / box.height;
      this.change(() => this.camera.zoom(Math.exp(0.0012 * Math.max(-300, Math.min(300, e.deltaY * (e.deltaMode ? 30 : 1)))), x, y));
    }, { passive: false });
    stage.addEventListener("dblclick", e => { if (!e.target.closest("button, label")) this.reset(); });
    stage.addEventListener("contextmenu", e => e.preventDefault());
    stage.addEventListener("pointerleave", e => { if (e.pointerType === "mouse") this.find(".tip").hidden = true; });
    this.find("canvas.gl").addEventListener("webglcontextlost", e => e.preventDefault());
    this.find("canvas.gl").addEventListener("webglcontextrestored", () => { this.surface = new Surface(this.find("canvas.gl")); this.dirty(); });
  }

  // What lies under the mouse: a hole with its tendon's tension, or a measured marker.
  hover(e) {
    const box = this.stage.getBoundingClientRect(), x = e.clientX - box.left, y = e.clientY - box.top, tip = this.find(".tip");
    let best = 12, text = "", depth = Infinity;
    const near = (point, say) => {
      const at = this.project(point);
      if (!at) return;
      const gap = Math.hypot(at[0] - x, at[1] - y);
      if (gap < best - 2 || (gap < best + 2 && at[2] < depth)) { best = Math.min(best, gap); depth = at[2]; text = say(); }
    };
    const m = this.motion, u = this.plots.unit, place = s => `s = ${short(u.factor * s)} ${u.name}`;
    for (const h of this.scene.holeList()) {
      near(h.at, () => {
        const below = m.tensionOf(h.segment), above = h.end ? null : m.tensionOf(h.segment + 1);
        const state = h.state ? `: ${STATE_TEXT[h.state]}` : "";
        return `${h.tendon.name}, ${h.end ? "anchor" : `hole ${h.number + 1}${state}`}, ${place(m.s[h.section])}\n${short(below)} N below${above === null ? "" : `, ${short(above)} N above`}`;
      });
    }
    if (m.measured && this.look.markers) {
      const count = m.measured.shape[1];
      for (let i = 0; i < count; i++) {
        const at = Array.from(m.measured.values.subarray(3 * (count * m.step + i), 3 * (count * m.step + i) + 3));
        if (!at.some(Number.isNaN)) near(at, () => `measured, ${place(m.markers.s[i])}\n(${at.map(v => short(u.factor * v)).join(", ")}) ${u.name}`);
      }
    }
    tip.hidden = !text;
    tip.textContent = text;
    tip.style.left = `${Math.min(x + 14, box.width - 230)}px`;
    tip.style.top = `${y + 16}px`;
  }
}

for (const root of document.querySelectorAll(".robot-view")) root.panel = new Panel(root);
