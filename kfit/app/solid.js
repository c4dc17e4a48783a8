// Starts the answer's 3D view, now and whenever there is another answer; `kfitScene` is defined above.
function start() {
  const figure = element.querySelector(".kfit-scene");
  if (!figure || figure.dataset.started || !props.scene) return;
  figure.dataset.started = "yes";
  kfitScene(figure, JSON.parse(props.scene));
}

watch(["value", "scene"], start);
start(); // the page may show the part only once there is an answer
