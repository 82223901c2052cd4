// A row of the table chooses its joint. The table stands in a shadow tree: the event tells what was clicked in it.
document.addEventListener("click", (event) => {
  const line = event.composedPath().find((one) => one.dataset && one.dataset.joint !== undefined);
  if (line) {
    Bokeh.documents[0].get_model_by_name("joint").value = line.dataset.joint;
  }
});
document.documentElement.dataset.page = "ready";
