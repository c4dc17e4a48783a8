// Brings a fit into view when it begins, where it would run below the bottom of a phone's screen.
let before = "";
watch("value", () => {
  const begins = props.value && !before;
  before = props.value;
  if (begins && element.getBoundingClientRect().top > window.innerHeight / 2) element.scrollIntoView();
});
