// Brings the answer's 3D view to life whenever there is another answer; `kfitScene` stands above.
watch(["value", "scene"], () => {
  const figure = element.querySelector(".kfit-scene");
  if (figure && props.scene) kfitScene(figure, JSON.parse(props.scene));
});
