// The fleet's table is sorted and filtered here, and the plots show the joint that is chosen.
(function () {
  "use strict";
  const table = document.getElementById("joints");
  if (!table) {
    return;
  }
  const body = table.tBodies[0];
  const rows = [...body.rows];
  const data = JSON.parse(document.getElementById("data").textContent);
  const words = document.getElementById("filter");
  const status = document.getElementById("status");
  const ringing = document.getElementById("ringing");
  const count = document.getElementById("count");

  function show_chosen() {
    const wanted = words.value.toLowerCase().split(/\s+/).filter(Boolean);
    let shown = 0;
    for (const row of rows) {
      const text = row.dataset.text.toLowerCase();
      const here = wanted.every((word) => text.includes(word)) && (!status.value || row.dataset.status === status.value)
        && !(ringing && ringing.checked && !row.dataset.alarm);
      row.hidden = !here;
      shown += here;
    }
    const all = `${rows.length} joint${rows.length === 1 ? "" : "s"}`;
    count.textContent = shown === rows.length ? all : `${shown} of ${all}`;
  }

  // What has no value stands last, whichever way the column is sorted.
  function sort_by(head) {
    const column = head.cellIndex;
    const up = head.getAttribute("aria-sort") === "descending";
    const key = (row) => row.cells[column].dataset.sort ?? row.cells[column].textContent.trim();
    const as_number = rows.every((row) => row.cells[column].dataset.sort !== undefined);
    const empty = (value) => value === "" || value === "nan";
    rows.sort((one, other) => {
      const [a, b] = [key(one), key(other)];
      if (empty(a) || empty(b)) {
        return empty(a) - empty(b);
      }
      const order = as_number ? Number(a) - Number(b) : a.localeCompare(b, undefined, { numeric: true });
      return up ? order : -order;
    });
    for (const other of head.parentNode.cells) {
      other.removeAttribute("aria-sort");
    }
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    body.append(...rows);
  }

  function fill_plot(name, history) {
    const document_ = Bokeh.documents[0];
    const source = document_.get_model_by_name(`${name} history`);
    const figure = document_.get_model_by_name(name);
    const value = history.value;
    const low = value.map((one, at) => one - 2 * history.error[at]);
    const high = value.map((one, at) => one + 2 * history.error[at]);
    figure.visible = value.length > 0;
    source.data = { at: history.at, value, low, high };
    if (!value.length) {
      return;
    }
    const [first, last] = [Math.min(...history.at), Math.max(...history.at)];
    // A single recording stands in the middle of its day.
    const alone = figure.below[0].type === "DatetimeAxis" ? 12 * 3600e3 : 1;
    const margin = 0.03 * (last - first) || alone;
    let [bottom, top] = name === "stick_slip" ? [0, 100] : [Math.min(...low), Math.max(...high)];
    // What hardly changes is to look so.
    const span = Math.max(...value.map(Math.abs)) * 0.2 || 1;
    const room = Math.max(0.05 * (top - bottom), 0.5 * (span - (top - bottom)));
    figure.x_range.setv({ start: first - margin, end: last + margin, reset_start: first - margin, reset_end: last + margin });
    figure.y_range.setv({ start: bottom - room, end: top + room, reset_start: bottom - room, reset_end: top + room });
  }

  function cell(row, text, name) {
    const found = row.insertCell();
    found.textContent = text;
    found.className = name || "";
    return found;
  }

  function show_joint(index) {
    const joint = data[index];
    document.getElementById("chosen").textContent = joint.title;
    for (const [name, history] of Object.entries(joint.histories)) {
      const figure = document.querySelector(`figure[data-plot="${name}"]`);
      figure.hidden = history.value.length === 0;
      fill_plot(name, history);
    }
    const list = document.getElementById("recordings").tBodies[0];
    list.replaceChildren();
    for (const one of joint.rows) {
      const row = list.insertRow();
      const [bag, date, usual, worst, ...numbers] = one;
      const link = numbers.pop();
      const first = cell(row, link ? "" : bag);
      if (link) {
        const anchor = document.createElement("a");
        anchor.href = link;
        anchor.textContent = bag;
        first.append(anchor);
      }
      cell(row, date, "text");
      cell(row, usual.replaceAll("_", " "), `text chip ${usual}`);
      cell(row, worst.replaceAll("_", " "), `text chip ${worst}`);
      numbers.forEach((number) => cell(row, number));
    }
    for (const row of rows) {
      row.classList.toggle("chosen", Number(row.dataset.index) === index);
    }
  }

  table.tHead.addEventListener("click", (event) => {
    const head = event.target.closest("th");
    if (head) {
      sort_by(head);
    }
  });
  body.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (button) {
      show_joint(Number(button.closest("tr").dataset.index));
      document.getElementById("detail").scrollIntoView({ behavior: "smooth" });
    }
  });
  for (const control of [words, status, ringing]) {
    control?.addEventListener("input", show_chosen);
  }
  show_chosen();

  function begin(tries) {
    if (window.Bokeh && Bokeh.documents.length > 0) {
      show_joint(0);
      document.documentElement.dataset.joints = "ready";
    } else if (tries > 0) {
      window.setTimeout(begin, 50, tries - 1);
    }
  }
  window.addEventListener("load", () => begin(200));
})();
