// Drawing in WebGL 2: solids of revolution about a curve, many of each kind in one call.
//
// A mesh is a profile (place t along the axis, radius rho, normal) turned about the axis. One instance has a start, an
// end and the tangents there, so that the axis is a cubic curve: a bent beam element, a straight rod, a cone, a ball.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const times = (s, a) => [s * a[0], s * a[1], s * a[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = a => times(1 / (Math.hypot(...a) || 1), a);

const VERTEX = `#version 300 es
in vec4 profile;                       // t, rho, normal along the axis, normal across it
in vec2 around;                        // cosine and sine of the angle about the axis
in vec3 start, startTangent, end, endTangent, side, endSide;
in vec2 radii;
in vec4 colour;
uniform mat4 camera;
out vec3 normal, place;
out vec4 paint;
void main() {
  float t = profile.x, u = 1.0 - t;
  vec3 centre = u * u * (1.0 + 2.0 * t) * start + t * u * u * startTangent
              + t * t * (3.0 - 2.0 * t) * end - t * t * u * endTangent;
  vec3 along = normalize(6.0 * t * u * (end - start) + u * (1.0 - 3.0 * t) * startTangent
             + t * (3.0 * t - 2.0) * endTangent);
  vec3 x = mix(side, endSide, t);
  x = normalize(x - dot(x, along) * along);
  vec3 across = around.x * x + around.y * cross(along, x);
  place = centre + mix(radii.x, radii.y, t) * profile.y * across;
  normal = profile.z * along + profile.w * across;
  paint = colour;
  gl_Position = camera * vec4(place, 1.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
in vec3 normal, place;
in vec4 paint;
uniform vec3 eye, light;
uniform float sheen;
out vec4 result;
void main() {
  vec3 n = normalize(normal), view = normalize(eye - place);
  if (dot(n, view) < 0.0) n = -n;
  float lit = 0.60 + 0.32 * max(dot(n, light), 0.0) + 0.14 * max(dot(n, view), 0.0);
  float gloss = sheen * pow(max(dot(n, normalize(light + view)), 0.0), 40.0);
  result = vec4(paint.rgb * lit + gloss, paint.a);
}`;

// Profiles as rows of t, rho, normal along, normal across.
const PROFILES = {
  rod: [[0, 0, -1, 0], [0, 1, -1, 0], [0, 1, 0, 1], [1, 1, 0, 1], [1, 1, 1, 0], [1, 0, 1, 0]],
  wire: [[0, 1, 0, 1], [1, 1, 0, 1]],
  beam: [0, 1, 2, 3, 4, 5, 6].map(i => [i / 6, 1, 0, 1]),
  cone: [[0, 0, -1, 0], [0, 1, -1, 0], [0, 1, 0.4, 0.92], [1, 0, 0.4, 0.92]],
  ball: [0, 1, 2, 3, 4, 5, 6].map(i => {
    const a = Math.PI * i / 6;
    return [(1 - Math.cos(a)) / 2, Math.sin(a), -Math.cos(a), Math.sin(a)];
  }),
};
const SIDES = { rod: 32, wire: 8, beam: 14, cone: 14, ball: 10 };
const FLOATS = 24; // of one instance

// Instances of one mesh, filled anew for every picture.
class Batch {
  constructor(gl, program, rows, sides) {
    this.gl = gl;
    const vertices = [], indices = [], ring = sides + 1;
    rows.forEach((row, i) => {
      for (let j = 0; j < ring; j++) {
        const a = 2 * Math.PI * j / sides;
        vertices.push(...row, Math.cos(a), Math.sin(a));
        if (i && j) {
          const b = ring * i + j;
          indices.push(b - ring - 1, b - ring, b - 1, b - 1, b - ring, b);
        }
      }
    });
    this.corners = indices.length;
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(vertices), gl.STATIC_DRAW);
    this.attributes(program, [["profile", 4], ["around", 2]], 6, 0);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint16Array(indices), gl.STATIC_DRAW);
    this.buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    this.attributes(program, [["start", 3], ["startTangent", 3], ["end", 3], ["endTangent", 3], ["side", 3], ["endSide", 3],
      ["radii", 2], ["colour", 4]], FLOATS, 1);
    gl.bindVertexArray(null);
    this.data = new Float32Array(64 * FLOATS);
    this.count = 0;
  }

  attributes(program, fields, floats, divisor) {
    let offset = 0;
    for (const [name, size] of fields) {
      const at = this.gl.getAttribLocation(program, name);
      this.gl.enableVertexAttribArray(at);
      this.gl.vertexAttribPointer(at, size, this.gl.FLOAT, false, 4 * floats, 4 * offset);
      this.gl.vertexAttribDivisor(at, divisor);
      offset += size;
    }
  }

  put(a, ta, b, tb, side, endSide, ra, rb, colour) {
    if ((this.count + 1) * FLOATS > this.data.length) {
      const larger = new Float32Array(2 * this.data.length);
      larger.set(this.data);
      this.data = larger;
    }
    const d = this.data;
    let i = this.count++ * FLOATS;
    for (const v of [a, ta, b, tb, side, endSide]) { d[i++] = v[0]; d[i++] = v[1]; d[i++] = v[2]; }
    d[i++] = ra; d[i++] = rb;
    d[i++] = colour[0]; d[i++] = colour[1]; d[i++] = colour[2]; d[i] = colour[3] ?? 1;
  }

  // A straight one from a to b.
  line(a, b, ra, rb, colour) {
    const t = sub(b, a), side = Math.abs(t[2]) > 0.9 * Math.hypot(...t) ? [1, 0, 0] : [0, 0, 1];
    this.put(a, t, b, t, side, side, ra, rb, colour);
  }

  draw() {
    if (!this.count) return;
    const gl = this.gl;
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, this.data.subarray(0, this.count * FLOATS), gl.DYNAMIC_DRAW);
    gl.drawElementsInstanced(gl.TRIANGLES, this.corners, gl.UNSIGNED_SHORT, 0, this.count);
    gl.bindVertexArray(null);
  }
}

// Whether there is no graphics card: then a picture with smooth edges takes 28 ms in place of 7.
function drawnInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2"), info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

// The drawing surface; throws an error where the browser has no WebGL 2.
class Surface {
  constructor(canvas) {
    this.canvas = canvas;
    const look = { alpha: true, premultipliedAlpha: true, antialias: !drawnInSoftware() };
    const gl = this.gl = canvas.getContext("webgl2", look);
    if (!gl) throw new Error("no WebGL 2");
    this.program = this.link();
    this.batches = Object.fromEntries(Object.entries(PROFILES).map(([name, rows]) =>
      [name, new Batch(gl, this.program, rows, SIDES[name])]));
    this.glass = new Batch(gl, this.program, PROFILES.rod, SIDES.rod); // drawn last, see-through
    this.uniform = Object.fromEntries(["camera", "eye", "light", "sheen"].map(n => [n, gl.getUniformLocation(this.program, n)]));
    gl.enable(gl.DEPTH_TEST);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  link() {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }

  clear() {
    for (const batch of [...Object.values(this.batches), this.glass]) batch.count = 0;
  }

  draw(camera) {
    const gl = this.gl;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(this.uniform.camera, false, camera.matrix);
    gl.uniform3fv(this.uniform.eye, camera.eye);
    gl.uniform3fv(this.uniform.light, unit(add(add(times(0.9, camera.up), times(-0.5, camera.right)), times(-0.7, camera.forward))));
    gl.uniform1f(this.uniform.sheen, 0.18);
    for (const batch of Object.values(this.batches)) batch.draw();
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    this.glass.draw();
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }
}

// A camera that turns about a target; z is up. Angles in radians.
class Camera {
  constructor(points, home) {
    this.points = points;
    this.home = home;
    [this.low, this.high] = [Math.min, Math.max].map(pick => [0, 1, 2].map(i => points.reduce((a, p) => pick(a, p[i]), points[0][i])));
    this.field = 0.5;
    this.aspect = 1;
    this.reset();
  }

  reset() {
    this.turn = this.home; this.lift = 0.32;
    this.fit();
  }

  // Look at all points from the present direction, in the middle of the picture.
  fit() {
    this.target = times(0.5, add(this.low, this.high));
    this.update(1);
    const flat = this.points.map(p => { const d = sub(p, this.target); return [dot(d, this.right), dot(d, this.up), dot(d, this.forward)]; });
    const [x, y] = [0, 1].map(i => flat.reduce(([a, b], p) => [Math.min(a, p[i]), Math.max(b, p[i])], [Infinity, -Infinity])).map(([a, b]) => (a + b) / 2);
    this.target = add(this.target, add(times(x, this.right), times(y, this.up)));
    const tall = Math.tan(this.field / 2), wide = tall * this.aspect;
    const needed = flat.map(p => Math.max(Math.abs(p[0] - x) / wide, Math.abs(p[1] - y) / tall) - p[2]);
    this.update(1.14 * Math.max(...needed));
  }

  update(distance = this.distance) {
    this.distance = distance;
    const c = Math.cos(this.lift);
    this.forward = [-c * Math.cos(this.turn), -c * Math.sin(this.turn), -Math.sin(this.lift)];
    this.right = [-Math.sin(this.turn), Math.cos(this.turn), 0];
    this.up = cross(this.right, this.forward);
    this.eye = sub(this.target, times(this.distance, this.forward));
    const f = 1 / Math.tan(this.field / 2), near = this.distance / 200, far = this.distance * 20;
    const x = times(f / this.aspect, this.right), y = times(f, this.up), z = this.forward;
    const a = (far + near) / (far - near), b = -2 * far * near / (far - near);
    this.matrix = new Float32Array([x[0], y[0], a * z[0], z[0], x[1], y[1], a * z[1], z[1], x[2], y[2], a * z[2], z[2],
      -dot(x, this.eye), -dot(y, this.eye), -a * dot(z, this.eye) + b, -dot(z, this.eye)]);
  }

  // Place of a point in a picture of that size [pixels], with its depth; null behind the eye.
  project(point, width, height) {
    const m = this.matrix, w = m[3] * point[0] + m[7] * point[1] + m[11] * point[2] + m[15];
    if (w <= 0) return null;
    const x = m[0] * point[0] + m[4] * point[1] + m[8] * point[2] + m[12];
    const y = m[1] * point[0] + m[5] * point[1] + m[9] * point[2] + m[13];
    return [(0.5 + 0.5 * x / w) * width, (0.5 - 0.5 * y / w) * height, w];
  }

  // Length of one pixel at the target, in a picture of that height.
  pixel(height) { return 2 * this.distance * Math.tan(this.field / 2) / height; }

  orbit(dx, dy) {
    this.turn -= dx;
    this.lift = Math.max(-1.55, Math.min(1.55, this.lift + dy));
    this.update();
  }

  // Move the target by a distance in pixels, for a picture of that height.
  pan(dx, dy, height) {
    const scale = this.pixel(height);
    this.target = add(this.target, add(times(-dx * scale, this.right), times(dy * scale, this.up)));
    this.update();
  }

  // Zoom by a factor about a place, given from -1 to 1 in both directions.
  zoom(factor, x = 0, y = 0) {
    const size = Math.hypot(...sub(this.high, this.low)) || 1;
    const next = Math.max(0.02 * size, Math.min(12 * size, this.distance * factor));
    const moved = (this.distance - next) * Math.tan(this.field / 2);
    this.target = add(this.target, add(times(moved * x * this.aspect, this.right), times(moved * y, this.up)));
    this.update(next);
  }
}
