// The photo under the pointer. Python hears of a box as the event 'draw', of a brush stroke as 'stroke', and of a tap on
// something that was found as 'pick'. A box is drawn by dragging, or by two taps on opposite corners.
const TAP = 8; // a press that moves by fewer pixels is a tap
let mode = "box"; // or "add" or "remove", which paint
let corner = null; // of the box that is being drawn, in fractions of the picture
let pressed = null; // where the pointer went down, in pixels
let tapped = false; // the corner was set by a tap, and the next one ends the box
let points = []; // of the stroke that is being painted, in fractions of the picture

const stage = () => element.querySelector(".kfit-stage");
const reset = () => { corner = pressed = null; tapped = false; points = []; };

function place(event) {
  const room = stage().getBoundingClientRect();
  const within = (value) => Math.min(1, Math.max(0, value));
  return [within((event.clientX - room.left) / room.width), within((event.clientY - room.top) / room.height)];
}

function between(a, b) {
  return [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.abs(a[0] - b[0]), Math.abs(a[1] - b[1])];
}

function show(box) {
  const names = ["left", "top", "width", "height"];
  const drawn = element.querySelector(".kfit-box");
  names.forEach((name, k) => { drawn.style[name] = `${100 * box[k]}%`; });
  drawn.classList.add("kfit-there");
  const mask = element.querySelector(".kfit-mask");
  if (mask) mask.style.visibility = "hidden"; // it is of another box
}

function paint(point) {
  points.push(point);
  const line = element.querySelector(".kfit-stroke polyline");
  const ends = points.length > 1 ? points : [point, point];
  line.setAttribute("points", ends.map(([x, y]) => `${x * props.aspect},${y}`).join(" "));
  line.setAttribute("class", mode);
}

function found(point) { // the smallest of what was found at this place
  const there = [...element.querySelectorAll(".kfit-found")].filter(({ dataset }) => {
    const [left, top, width, height] = dataset.box.split(" ").map(Number);
    return point[0] >= left && point[0] <= left + width && point[1] >= top && point[1] <= top + height;
  });
  const area = ({ dataset }) => { const box = dataset.box.split(" "); return box[2] * box[3]; };
  return there.sort((a, b) => area(a) - area(b))[0];
}

function finish(end) {
  const box = between(corner, end);
  reset();
  if (box[2] > 0 && box[3] > 0) trigger("draw", { box });
}

element.addEventListener("click", (event) => {
  const button = event.target.closest("[data-mode]");
  if (!button) return;
  mode = button.dataset.mode;
  reset();
  element.querySelectorAll("[data-mode]").forEach((other) => other.setAttribute("aria-pressed", other === button));
});

element.addEventListener("pointerdown", (event) => {
  if (!event.isPrimary || event.button !== 0 || !stage()?.contains(event.target)) return;
  event.preventDefault();
  stage().setPointerCapture(event.pointerId);
  pressed = [event.clientX, event.clientY];
  if (mode !== "box") return paint(place(event));
  if (!tapped) corner = place(event);
});

element.addEventListener("pointermove", (event) => {
  if (!event.isPrimary || !stage()) return;
  if (mode !== "box") return pressed && paint(place(event));
  if (corner && (pressed || tapped)) show(between(corner, place(event)));
});

element.addEventListener("pointerup", (event) => {
  if (!event.isPrimary || !pressed || !stage()) return;
  const still = Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < TAP;
  pressed = null;
  if (mode !== "box") {
    trigger("stroke", { points, keep: mode === "add" });
    return reset();
  }
  const thing = still && !tapped ? found(place(event)) : null;
  if (thing) {
    reset();
    trigger("pick", { number: +thing.dataset.number });
  } else if (still && !tapped) {
    tapped = true;
    show(between(corner, corner));
  } else finish(place(event));
});

element.addEventListener("pointercancel", reset);

watch(["photo", "mask"], () => {
  reset();
  if (!element.querySelector(`[data-mode="${mode}"]`)) mode = "box";
  element.querySelectorAll("[data-mode]").forEach((one) => one.setAttribute("aria-pressed", one.dataset.mode === mode));
});
