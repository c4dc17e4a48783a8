// A press on a card hands its example's name to Python as the event 'pick'.
element.addEventListener("click", (event) => {
  const card = event.target.closest("[data-example]");
  if (card) trigger("pick", { name: card.dataset.example });
});
