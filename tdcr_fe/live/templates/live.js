// A live robot: sliders for its tendons, and the mouse that pulls. Every change is a load step that the server solves.

const STEPS_SHOWN = 1000;    // load steps on the page; the server keeps them all
const GRAB = 18;             // distance from a disk within which the mouse grabs it [pixels]

class Live {
  constructor(panel, form) {
    this.panel = panel;
    this.form = form;
    Object.assign(this, JSON.parse(form.querySelector("script").textContent));
    this.query = `token=${new URLSearchParams(location.search).get("token")}&page=${this.page}`;
    this.find = selector => form.querySelector(selector);
    this.wish = {};          // changes that wait for the answer to the one before
    this.asking = false;
    this.section = this.places.map(s => panel.motion.s.reduce((best, x, i, all) => Math.abs(x - s) < Math.abs(all[best] - s) ? i : best, 0));
    this.controls();
    this.mouse();
    this.room();
    this.watch();
    panel.drawOver = pen => this.spring(pen);
  }

  // The camera sees where the robot may go, and not only where it is.
  room() {
    const { camera } = this.panel, far = 0.7 * this.panel.motion.length;
    const around = [[far, 0], [-far, 0], [0, far], [0, -far]].map(([x, y]) => [x, y, far]);
    this.panel.camera = new Camera([...camera.points, ...around], camera.home);
    this.panel.resize();
  }

  // ---------------------------------------------------------------------------------------------------- asking

  // One change at a time: while one is solved, the newest of each kind waits, in the order in which they were asked for.
  async want(kind, value) {
    const before = kind === "restart" ? (this.wish = {}) : this.wish[kind];
    delete this.wish[kind];
    this.wish[kind] = typeof value === "object" ? { ...before, ...value } : value;
    if (this.asking) return;
    this.asking = true;
    try {
      for (let next; (next = Object.entries(this.wish)[0]);) {
        delete this.wish[next[0]];
        await this.ask(...next);
      }
    } finally {
      this.asking = false;
    }
  }

  async ask(kind, value) {
    const driven = ["tensions", "displacements"].includes(kind), message = driven ? { drive: { [kind]: value } } : { [kind]: value };
    let reply;
    try {
      reply = await fetch(`/change?${this.query}`, { method: "POST", body: JSON.stringify(message) });
    } catch {
      return this.end("The program has ended. What is shown stays.");
    }
    if (reply.status === 409) return this.end(await reply.text());
    const answer = reply.ok ? await reply.json() : { message: await reply.text(), made: false };
    this.say(answer.message);
    if (kind === "friction") this.find("[data-do=friction]").checked = answer.made === value;
    if (!answer.made) return;
    this.find("[data-say=time]").textContent = `load step solved in ${answer.milliseconds.toPrecision(2)} ms`;
    const step = new Motion(answer.motion), { panel } = this, { motion, plots } = panel;
    if (kind === "restart") motion.clear();
    else step.steps = [motion.steps.at(-1) + 1]; // also where the friction was switched, and the sequence has begun anew
    motion.append(step, STEPS_SHOWN);
    // The response that is looked for first: over the tendon that was moved first.
    if (driven && plots.input.value === "step") plots.input.value = `${kind.slice(0, -1)} ${this.tendons.findIndex(t => t.name in value)}`;
    panel.grown();
    if (kind === "restart") this.show();
    if (this.pulled && !answer.settled && !this.wish.pull) this.wish.pull = this.pulled;
  }

  say(text) { this.find("[data-say=message]").textContent = text; }

  end(text) {
    this.say(text);
    this.wish = {};
    this.ended = true;
    this.alive.close();
    for (const control of this.form.querySelectorAll("input, select, button")) control.disabled = true;
  }

  // A connection that stays open: server and page notice by it that the other has ended.
  watch() {
    this.alive = new EventSource(`/alive?${this.query}`);
    this.alive.addEventListener("replaced", () => this.end("The robot was opened in another page; this one has ended."));
    this.alive.addEventListener("error", () => this.end("The program has ended. What is shown stays."));
  }

  // -------------------------------------------------------------------------------------------------- controls

  controls() {
    this.drive = this.tendons.some(t => t.pretension > 0) ? "displacement" : "tension";
    this.find("[data-choice=drive]").value = this.drive;
    this.find("[data-choice=drive]").addEventListener("change", e => { this.drive = e.target.value; this.show(); });
    const rows = this.find(".tendons");
    for (const tendon of this.tendons) {
      const row = document.createElement("label"), name = document.createElement("span");
      name.textContent = tendon.name;
      [tendon.slider, tendon.number] = ["range", "number"].map(type => Object.assign(document.createElement("input"), { type }));
      tendon.slider.setAttribute("aria-label", `${tendon.name}, slider`);
      tendon.unit = document.createElement("span");
      for (const [input, other] of [[tendon.slider, tendon.number], [tendon.number, tendon.slider]]) {
        input.addEventListener("input", () => {
          if (!Number.isFinite(input.valueAsNumber)) return;
          other.value = input.value;
          this.want(`${this.drive}s`, { [tendon.name]: input.valueAsNumber / this.scale });
        });
      }
      row.append(name, tendon.slider, tendon.number, tendon.unit);
      rows.append(row);
    }
    this.find("[data-do=friction]").checked = this.friction;
    this.find("[data-do=friction]").addEventListener("change", e => this.want("friction", e.target.checked));
    for (const kind of ["let_go", "restart"]) this.find(`[data-do=${kind}]`).addEventListener("click", () => this.want(kind, true));
    this.form.addEventListener("submit", e => e.preventDefault());
    this.find("a[download]").href = `/scenario.toml?${this.query}`;
    this.show();
  }

  // Sliders and numbers as the robot is driven now.
  show() {
    const { motion, plots } = this.panel, byTension = this.drive === "tension", k = motion.count - 1;
    const values = byTension ? motion.baseTension : motion.displacement;
    this.scale = byTension ? 1 : plots.unit.factor;
    this.tendons.forEach((tendon, j) => {
      const high = this.scale * tendon[this.drive], step = round125(high / 1000), low = byTension ? 0 : -250 * step; // so that zero is among its values
      const value = +(this.scale * values[this.tendons.length * k + j]).toPrecision(4);
      for (const input of [tendon.slider, tendon.number]) {
        Object.assign(input, { min: input === tendon.slider || byTension ? low : "", step: input === tendon.slider ? step : "any" });
        if (input === tendon.slider) input.max = high;
        input.value = value;
      }
      tendon.unit.textContent = byTension ? "N" : plots.unit.name;
    });
  }

  // ----------------------------------------------------------------------------------------------------- mouse

  // Dragging a disk or the tip pulls it, in the plane of the picture through where it was grabbed.
  mouse() {
    const { panel } = this, { stage } = panel;
    const place = e => { const box = stage.getBoundingClientRect(); return [e.clientX - box.left, e.clientY - box.top]; };
    stage.addEventListener("pointerdown", e => {
      if (e.button || e.shiftKey || this.ended || e.target.closest("button, label") || panel.motion.step < panel.motion.count - 1) return;
      const found = this.nearest(place(e));
      if (found === null) return;
      e.stopImmediatePropagation();
      stage.setPointerCapture(e.pointerId);
      const start = panel.motion.point(this.section[found], [0, 0, 0]);
      this.grabbed = { place: found, pointer: e.pointerId, from: place(e), start, depth: panel.project(start)[2] };
    }, true);
    stage.addEventListener("pointermove", e => {
      if (!this.grabbed) {
        stage.classList.toggle("grab", this.nearest(place(e)) !== null);
        return;
      }
      if (e.pointerId !== this.grabbed.pointer) return;
      e.stopImmediatePropagation();
      const [x, y] = place(e), { from, start, depth } = this.grabbed, { camera } = panel;
      const pixel = 2 * depth * Math.tan(camera.field / 2) / panel.size[1];
      const to = add(start, add(times(pixel * (x - from[0]), camera.right), times(-pixel * (y - from[1]), camera.up)));
      this.pulled = { place: this.grabbed.place, to };
      panel.dirty();
      this.want("pull", this.pulled);
    }, true);
    for (const name of ["pointerup", "pointercancel"]) stage.addEventListener(name, e => {
      if (!this.grabbed || e.pointerId !== this.grabbed.pointer) return;
      this.grabbed = null;
      if (this.pulled && !this.find("[data-do=hold]").checked) { delete this.wish.pull; this.want("let_go", true); }
      this.pulled = null;
      panel.dirty();
    }, true);
  }

  // The place that is nearest to the mouse; null where none is near.
  nearest([x, y]) {
    const gaps = this.section.map(section => {
      const at = this.panel.project(this.panel.motion.point(section, [0, 0, 0]));
      return at ? Math.hypot(at[0] - x, at[1] - y) : Infinity;
    });
    const least = Math.min(...gaps);
    return least < GRAB ? gaps.indexOf(least) : null;
  }

  // The spring, as a line from the robot to the mouse.
  spring(pen) {
    if (!this.pulled) return;
    const { panel } = this, ends = [panel.motion.point(this.section[this.pulled.place], [0, 0, 0]), this.pulled.to].map(p => panel.project(p));
    if (!ends.every(Boolean)) return;
    pen.strokeStyle = getComputedStyle(panel.root).getPropertyValue("--bad");
    pen.lineWidth = 2;
    pen.setLineDash([5, 4]);
    pen.beginPath(); pen.moveTo(ends[0][0], ends[0][1]); pen.lineTo(ends[1][0], ends[1][1]); pen.stroke();
    pen.setLineDash([]);
  }
}

const live = document.querySelector("form.live");
live.control = new Live(document.querySelector(".robot-view").panel, live);
