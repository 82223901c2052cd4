// Plots follow the page's colours: light, dark, and always light on paper.
(function () {
  "use strict";
  const query = window.matchMedia("(prefers-color-scheme: dark)");
  const schemes = {
    light: { paper: "#ffffff", ink: "#1b1f24", faint: "#57606a", grid: "#e5e8eb", line: "#8c959f" },
    dark: { paper: "#0d1117", ink: "#e6edf3", faint: "#9198a1", grid: "#262c36", line: "#656c76" },
  };

  function paint(dark) {
    const c = dark ? schemes.dark : schemes.light;
    for (const doc of Bokeh.documents) {
      for (const model of doc._all_models.values()) {
        const kind = model.type;
        if (kind === "Figure") {
          model.setv({ background_fill_color: c.paper, border_fill_color: c.paper, outline_line_color: c.line });
        } else if (["LinearAxis", "LogAxis", "DatetimeAxis"].includes(kind)) {
          model.setv({
            axis_label_text_color: c.ink, major_label_text_color: c.faint, axis_line_color: c.line,
            major_tick_line_color: c.line, minor_tick_line_color: null,
          });
        } else if (kind === "Grid") {
          model.setv({ grid_line_color: c.grid });
        } else if (kind === "Legend") {
          model.setv({
            background_fill_color: c.paper, label_text_color: c.ink, border_line_color: c.line,
            inactive_fill_color: c.paper,
          });
        } else if (model.tags && model.tags.includes("ink")) {
          const known = model.properties;
          for (const name of ["line_color", "fill_color", "hatch_color", "text_color"]) {
            if (name in known) {
              model.setv({ [name]: c.ink });
            }
          }
        }
      }
    }
    document.documentElement.dataset.scheme = dark ? "dark" : "light";
  }

  // A drag on a touch screen scrolls the page; zooming there is by the buttons.
  function leave_touch_alone() {
    if (!window.matchMedia("(pointer: coarse)").matches) {
      return;
    }
    for (const doc of Bokeh.documents) {
      for (const model of doc._all_models.values()) {
        if (model.type === "Toolbar") {
          model.active_drag = null;
        }
      }
    }
  }

  function begin(tries) {
    const ready = window.Bokeh && Bokeh.documents.length > 0;
    if (!ready && tries > 0) {
      window.setTimeout(begin, 50, tries - 1);
      return;
    }
    if (!ready) {
      return;
    }
    paint(query.matches);
    leave_touch_alone();
    query.addEventListener("change", () => paint(query.matches));
    window.addEventListener("beforeprint", () => paint(false));
    window.addEventListener("afterprint", () => paint(query.matches));
    document.documentElement.dataset.plots = "ready";
  }
  window.addEventListener("load", () => begin(200));
})();
