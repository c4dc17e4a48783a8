// A fitted object in 3D, turned by pointer or keys: mesh, box, axes and cameras, in WebGL 2 and without a library.
// All lengths are in diagonals of the object's box, all axes the object's (y up); `kfit.reports.scene` makes the scene.
function kfitViewer(canvas, scene) {
  const gl = canvas.getContext("webgl2", { antialias: true, premultipliedAlpha: false });
  if (!gl) return null;
  const FOCAL = 2.6, RADIANS = Math.PI / 180, BOX = "#ffb000", AXES = ["#e62828", "#1eaa3c", "#4a7dff"];
  const style = (name) => getComputedStyle(canvas).getPropertyValue(name).trim() || "#888888";
  const rgb = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
  const state = { azimuth: 0, elevation: 0, roll: 0, away: 2.7 };
  let chosen = 0, frame = 0, timer = 0;

  function program(vertex, fragment) {
    const made = gl.createProgram();
    [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]].forEach(([kind, text]) => {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, "#version 300 es\nprecision highp float;\n" + text);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    });
    gl.linkProgram(made);
    return made;
  }

  function attribute(made, name, data, size, kind, normalized) {
    const buffer = gl.createBuffer(), at = gl.getAttribLocation(made, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    if (data) gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, size, kind, normalized, 0, 0);
    return buffer;
  }

  const solid = program(
    `uniform mat3 turn; uniform vec3 lens; in vec3 place, normal, colour; out vec3 shade;
     void main() { vec3 p = turn * place; p.z -= lens.z; float lit = .72 + .28 * max(0., dot(turn * normal, vec3(.3, .6, .74)));
       shade = colour * lit; gl_Position = vec4(p.xy * lens.xy, (-p.z - .2) * 1.01, -p.z); }`,
    "in vec3 shade; out vec4 ink; void main() { ink = vec4(shade, 1); }");
  const flat = program(
    "in vec4 place, colour; out vec4 shade; void main() { shade = colour; gl_Position = place; }",
    "uniform float strength; in vec4 shade; out vec4 ink; void main() { ink = vec4(shade.rgb, shade.a * strength); }");

  let mesh = null, triangles = 0;
  if (scene.mesh) {
    const raw = new Int16Array(bytes(scene.mesh.vertices)), faces = new Uint32Array(bytes(scene.mesh.faces));
    const places = Float32Array.from(raw, (value) => value / 32767), normals = new Float32Array(places.length);
    for (let k = 0; k < faces.length; k += 3) {
      const [a, b, c] = [faces[k], faces[k + 1], faces[k + 2]].map((v) => places.subarray(3 * v, 3 * v + 3));
      const u = b.map((value, i) => value - a[i]), v = c.map((value, i) => value - a[i]);
      const out = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      for (let i = 0; i < 9; i++) normals[3 * faces[k + Math.floor(i / 3)] + (i % 3)] += out[i % 3];
    }
    for (let k = 0; k < normals.length; k += 3) {
      const long = Math.hypot(normals[k], normals[k + 1], normals[k + 2]) || 1;
      for (let i = 0; i < 3; i++) normals[k + i] /= long;
    }
    mesh = gl.createVertexArray();
    gl.bindVertexArray(mesh);
    attribute(solid, "place", places, 3, gl.FLOAT, false);
    attribute(solid, "normal", normals, 3, gl.FLOAT, false);
    attribute(solid, "colour", new Uint8Array(bytes(scene.mesh.colors)), 3, gl.UNSIGNED_BYTE, true);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
    triangles = faces.length;
  }
  const lines = gl.createVertexArray();
  gl.bindVertexArray(lines);
  const linePlaces = attribute(flat, "place", null, 4, gl.FLOAT, false);
  const lineColours = attribute(flat, "colour", null, 4, gl.FLOAT, false);

  function turning() { // rows of Rz(roll) · Rx(elevation) · Ry(azimuth)
    const [a, e, r] = [state.azimuth, state.elevation, state.roll].map((degrees) => degrees * RADIANS);
    const [ca, sa, ce, se, cr, sr] = [Math.cos(a), Math.sin(a), Math.cos(e), Math.sin(e), Math.cos(r), Math.sin(r)];
    const x = [ca, 0, sa], y = [se * sa, ce, -se * ca];
    return [x.map((value, i) => cr * value - sr * y[i]), x.map((value, i) => sr * value + cr * y[i]), [-ce * sa, se, ce * ca]];
  }

  function segments() { // [from, to, colour, opacity, pixels]
    const half = scene.size.map((side) => side / 2), found = [];
    const corner = (k) => half.map((value, i) => (k >> i & 1 ? value : -value));
    for (let k = 0; k < 8; k++) for (let i = 0; i < 3; i++)
      if (!(k >> i & 1)) found.push([corner(k), corner(k | 1 << i), BOX, 1, 2]);
    AXES.forEach((colour, i) => found.push([[0, 0, 0], [0, 1, 2].map((j) => (i === j ? 0.55 : 0)), colour, 1, 3]));
    const eye = turning()[2];
    scene.views.forEach((view, k) => {
      const before = view.place.reduce((sum, value, i) => sum + value * eye[i], 0) / Math.hypot(...view.place);
      if (before > 0.98) return; // it would stand between the eye and the object
      const colour = k === chosen ? style("--accent") : style("--muted"), wide = k === chosen ? 2 : 1.2;
      found.push([[0, 0, 0], view.place, colour, 0.5, 1]);
      view.corners.forEach((end, i) => {
        found.push([view.place, end, colour, 1, wide], [end, view.corners[(i + 1) % 4], colour, 1, wide]);
      });
    });
    return found;
  }

  function draw() {
    frame = 0;
    const ratio = window.devicePixelRatio || 1, width = Math.round(canvas.clientWidth * ratio);
    const height = Math.round(canvas.clientHeight * ratio);
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    const turn = turning(), less = Math.min(width, height), lens = [FOCAL * less / width, FOCAL * less / height, state.away];
    if (mesh) {
      gl.useProgram(solid);
      gl.bindVertexArray(mesh);
      gl.uniformMatrix3fv(gl.getUniformLocation(solid, "turn"), true, turn.flat());
      gl.uniform3fv(gl.getUniformLocation(solid, "lens"), lens);
      gl.drawElements(gl.TRIANGLES, triangles, gl.UNSIGNED_INT, 0);
    }
    const seen = (point) => {
      const [x, y, z] = turn.map((row) => row[0] * point[0] + row[1] * point[1] + row[2] * point[2]);
      const w = lens[2] - z;
      return [x * lens[0], y * lens[1], (w - 0.2) * 1.01, w];
    };
    const places = [], colours = [];
    for (const [from, to, colour, opacity, pixels] of segments()) {
      const [a, b] = [seen(from), seen(to)];
      if (a[3] < 0.25 || b[3] < 0.25) continue; // behind the eye
      const across = [(b[0] / b[3] - a[0] / a[3]) * width, (b[1] / b[3] - a[1] / a[3]) * height];
      const long = Math.hypot(...across) || 1, wide = pixels * ratio / long;
      const side = [-across[1] * wide / width, across[0] * wide / height];
      const edge = (end, sign) => [end[0] + sign * side[0] * end[3], end[1] + sign * side[1] * end[3], end[2], end[3]];
      for (const [end, sign] of [[a, 1], [a, -1], [b, 1], [b, 1], [a, -1], [b, -1]]) {
        places.push(...edge(end, sign));
        colours.push(...rgb(colour), opacity);
      }
    }
    gl.useProgram(flat);
    gl.bindVertexArray(lines);
    [[linePlaces, places], [lineColours, colours]].forEach(([buffer, data]) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(data), gl.DYNAMIC_DRAW);
    });
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    for (const [test, strength] of [[true, 1], [false, 0.25]]) { // what the object hides shows faintly
      (test ? gl.enable : gl.disable).call(gl, gl.DEPTH_TEST);
      gl.uniform1f(gl.getUniformLocation(flat, "strength"), strength);
      gl.drawArrays(gl.TRIANGLES, 0, places.length / 4);
    }
    gl.disable(gl.BLEND);
  }

  const ask = () => { frame ||= requestAnimationFrame(draw); };
  const halt = () => { clearInterval(timer); timer = 0; };

  function move(change) {
    Object.assign(state, change);
    state.elevation = Math.min(89, Math.max(-89, state.elevation));
    state.away = Math.min(9, Math.max(1.2, state.away));
    canvas.dataset.azimuth = Math.round(state.azimuth);
    ask();
  }

  function glide(goal) { // the short way round
    halt();
    const from = { ...state }, begun = performance.now(), still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    const near = (angle, before) => before + ((angle - before + 540) % 360 + 360) % 360 - 180;
    const end = { ...goal, azimuth: near(goal.azimuth, from.azimuth) };
    timer = setInterval(() => {
      const t = still ? 1 : Math.min(1, (performance.now() - begun) / 400), way = t * t * (3 - 2 * t);
      move(Object.fromEntries(Object.keys(end).map((name) => [name, from[name] + way * (end[name] - from[name])])));
      if (t === 1) halt();
    }, 16);
  }

  const view = (number = chosen) => { // as the camera of this pose sees it
    chosen = number;
    const { azimuth, elevation, roll } = scene.views[number];
    glide({ azimuth, elevation, roll, away: 2.4 });
  };
  const spin = () => {
    if (timer) { halt(); return false; }
    timer = setInterval(() => move({ azimuth: state.azimuth + 0.6, roll: 0 }), 16);
    return true;
  };

  const fingers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    halt();
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const gap = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    const wide = fingers.size > 1 ? gap() : 0;
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (wide) return move({ away: state.away * wide / Math.max(gap(), 1) });
    move({
      azimuth: state.azimuth + 0.5 * (event.clientX - before[0]),
      elevation: state.elevation + 0.5 * (event.clientY - before[1]), roll: 0,
    });
  });
  ["pointerup", "pointercancel"].forEach((name) => {
    canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  });
  canvas.addEventListener("wheel", (event) => {
    if (document.activeElement !== canvas) return; // or the page could not be scrolled past it
    event.preventDefault();
    move({ away: state.away * Math.exp(event.deltaY / 800) });
  }, { passive: false });
  const KEYS = {
    ArrowLeft: () => move({ azimuth: state.azimuth - 10, roll: 0 }), ArrowRight: () => move({ azimuth: state.azimuth + 10, roll: 0 }),
    ArrowUp: () => move({ elevation: state.elevation - 10, roll: 0 }), ArrowDown: () => move({ elevation: state.elevation + 10, roll: 0 }),
    "+": () => move({ away: state.away / 1.15 }), "-": () => move({ away: state.away * 1.15 }), Home: () => view(),
  };
  canvas.addEventListener("keydown", (event) => {
    if (!KEYS[event.key]) return;
    event.preventDefault();
    halt();
    KEYS[event.key]();
  });
  new ResizeObserver(ask).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", ask);
  const first = scene.views[0]; // from beside the camera, so that it is seen
  move({ azimuth: first.azimuth + 35, elevation: Math.max(first.elevation - 12, 8), roll: 0 });
  return { view, spin };
}

// Starts the viewer of a `scene.html`, and has its buttons turn it.
function kfitScene(root, scene) {
  const viewer = kfitViewer(root.querySelector("canvas"), scene);
  const views = [...root.querySelectorAll("[data-view]")], spin = root.querySelector("[data-spin]");
  if (!viewer) {
    root.querySelector(".kfit-space").textContent = "This browser draws no 3D (WebGL 2).";
    root.querySelector(".kfit-tools").hidden = true;
    return;
  }
  views.forEach((button) => button.addEventListener("click", () => {
    viewer.view(+button.dataset.view);
    spin.setAttribute("aria-pressed", false);
    views.forEach((other) => other.setAttribute("aria-pressed", other === button));
    root.querySelector(".kfit-words").textContent = button.dataset.words;
  }));
  spin.addEventListener("click", () => spin.setAttribute("aria-pressed", viewer.spin()));
}
