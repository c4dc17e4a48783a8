// Draws a box over the photo: by dragging, or by two taps on opposite corners. Python hears of it as the event 'draw'.
const TAP = 8; // a press that moves by fewer pixels is a tap
let corner = null; // of the box that is being drawn, in fractions of the picture
let pressed = null; // where the pointer went down, in pixels
let tapped = false; // the corner was set by a tap, and the next one ends the box

const stage = () => element.querySelector(".kfit-stage");

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

function finish(end) {
  const box = between(corner, end);
  corner = pressed = null;
  tapped = false;
  if (box[2] > 0 && box[3] > 0) trigger("draw", { box });
}

element.addEventListener("pointerdown", (event) => {
  if (!event.isPrimary || event.button !== 0 || !stage()?.contains(event.target)) return;
  event.preventDefault();
  stage().setPointerCapture(event.pointerId);
  pressed = [event.clientX, event.clientY];
  if (!tapped) corner = place(event);
  show(between(corner, place(event)));
});

element.addEventListener("pointermove", (event) => {
  if (event.isPrimary && corner && (pressed || tapped) && stage()) show(between(corner, place(event)));
});

element.addEventListener("pointerup", (event) => {
  if (!event.isPrimary || !pressed || !stage()) return;
  const still = Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < TAP;
  pressed = null;
  if (still && !tapped) tapped = true;
  else finish(place(event));
});

element.addEventListener("pointercancel", () => { corner = pressed = null; tapped = false; });

watch("photo", () => { corner = pressed = null; tapped = false; });
