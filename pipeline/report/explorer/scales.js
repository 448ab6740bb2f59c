"use strict";
(() => {
  // Yield at any scale of one tolerance: straight lines between the scales that were computed.
  const box = document.getElementById("scales");
  const data = JSON.parse(document.getElementById("scales-data").textContent);
  const digits = (value) => String(Number(value.toPrecision(3)));
  const percent = (share) => `${(100 * share).toFixed(1)}\u00a0%`;
  const at = (points, scale) => {
    let k = 1;
    while (k < points.length - 1 && points[k][0] < scale) k += 1;
    const [low, high] = [points[k - 1], points[k]];
    const share = (scale - low[0]) / (high[0] - low[0]);
    return low.map((value, column) => value + share * (high[column] - value));
  };
  const list = document.createElement("select");
  data.tolerances.forEach((tolerance, number) => list.append(new Option(tolerance.title, number)));
  const slider = Object.assign(document.createElement("input"), { type: "range", step: 0.01, value: 1 });
  const answer = document.createElement("output");
  const tell = () => {
    const { points, limits } = data.tolerances[list.value];
    slider.min = points[0][0];
    slider.max = points[points.length - 1][0];
    const [scale, value, low, high] = at(points, Number(slider.value));
    const ends = limits.map((limit) => digits(limit * scale).replace("-", "\u2212")).join(" to ");
    answer.textContent = `${digits(scale)} times its limits, ${ends}\u00a0µm: yield ${percent(value)} (${percent(low)} to ${percent(high)}), estimated`;
    slider.setAttribute("aria-valuetext", answer.textContent);
  };
  const labelled = (text, control) => {
    const label = document.createElement("label");
    label.append(`${text} `, control);
    return label;
  };
  list.addEventListener("change", () => { slider.value = 1; tell(); });
  slider.addEventListener("input", tell);
  box.append(labelled("Scale one tolerance", list), labelled("Limits times", slider), answer);
  box.hidden = false;
  tell();
})();
