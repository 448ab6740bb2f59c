"use strict";
(() => {
  const box = document.getElementById("explorer");
  const data = JSON.parse(document.getElementById("explorer-data").textContent);
  const static_picture = box.querySelector("img");
  const template = document.createElement("template");
  template.innerHTML = "<svg></svg>";
  const SVG = template.content.firstChild.namespaceURI;

  const shape = (name, attributes, parent, text) => {
    const element = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (text !== undefined) element.textContent = text;
    if (parent) parent.append(element);
    return element;
  };

  // Round steps of an axis, about so many of them.
  const ticks = (low, high, count) => {
    const raw = (high - low) / count || 1;
    const power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((factor) => factor * power).find((candidate) => candidate >= raw);
    const values = [];
    for (let value = Math.ceil(low / step) * step; value <= high + 1e-9 * step; value += step) values.push(value);
    return { values, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
  };

  // Axes of a panel: returns the functions from data to pixels.
  const panel = (title, xLabel, yLabel, xs, ys, width = 420, height = 300) => {
    const left = 58, right = 12, top = 26, bottom = 44;
    const svg = shape("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": title });
    const spread = (values) => {
      const low = Math.min(...values), high = Math.max(...values);
      const margin = 0.06 * (high - low) || Math.abs(high) * 0.05 || 1;
      return [low - margin, high + margin];
    };
    const [xLow, xHigh] = spread(xs), [yLow, yHigh] = spread(ys);
    const x = (value) => left + (value - xLow) / (xHigh - xLow) * (width - left - right);
    const y = (value) => height - bottom - (value - yLow) / (yHigh - yLow) * (height - top - bottom);
    shape("text", { x: left, y: 15, class: "panel-title" }, svg, title);
    const across = ticks(xLow, xHigh, 6), up = ticks(yLow, yHigh, 5);
    for (const value of across.values) {
      shape("line", { x1: x(value), x2: x(value), y1: top, y2: height - bottom, class: "grid" }, svg);
      shape("text", { x: x(value), y: height - bottom + 15, "text-anchor": "middle" }, svg, value.toFixed(across.digits));
    }
    for (const value of up.values) {
      shape("line", { x1: left, x2: width - right, y1: y(value), y2: y(value), class: "grid" }, svg);
      shape("text", { x: left - 6, y: y(value) + 4, "text-anchor": "end" }, svg, value.toFixed(up.digits));
    }
    shape("text", { x: (left + width - right) / 2, y: height - 8, "text-anchor": "middle" }, svg, xLabel);
    shape("text", { x: 13, y: (top + height - bottom) / 2, "text-anchor": "middle", transform: `rotate(-90 13 ${(top + height - bottom) / 2})` }, svg, yLabel);
    return { svg, x, y, left, right: width - right, top, bottom: height - bottom };
  };

  const axis = (metric) => metric.unit ? `${metric.title} (${metric.unit})` : metric.title;
  const scatterBox = document.createElement("div");
  const loopBox = document.createElement("div");
  const forceBox = document.createElement("div");
  const line = document.createElement("p");
  line.className = "line";
  line.setAttribute("aria-live", "polite");
  let chosen = 0, horizontal = 0, vertical = Math.min(1, data.metrics.length - 1), dots = [];

  const tell = () => {
    const unit = data.units[chosen];
    line.textContent = `${unit.label}: ` + data.metrics
      .map((metric, number) => `${metric.inline} ${unit.values[number].toFixed(metric.decimals)} ${metric.unit}`.trim()).join(", ");
    dots.forEach((dot, number) => dot.classList.toggle("chosen", number === chosen));
    dots[chosen].parentElement.append(dots[chosen]);
  };

  const drawLoop = () => {
    const unit = data.units[chosen];
    const all = data.units.flatMap((other) => [Math.min(...other.angle), Math.max(...other.angle)]);
    const { svg, x, y } = panel(`Loop at crank angle ${data.crank}°`, "torque (N m)", "angle of the output (arcmin)", data.torque, all);
    const path = data.torque.map((torque, step) => `${step ? "L" : "M"}${x(torque).toFixed(1)},${y(unit.angle[step]).toFixed(1)}`).join("");
    shape("path", { d: path, class: "curve" }, svg);
    loopBox.replaceChildren(svg);
  };

  const drawForces = () => {
    const unit = data.units[chosen];
    if (!unit.force) {
      const note = document.createElement("p");
      note.className = "note";
      note.textContent = "The study keeps no contact forces of this unit (cycle.keep_contacts); filled points have them.";
      forceBox.replaceChildren(note);
      return;
    }
    const pins = unit.force.map((_, pin) => pin);
    const largest = Math.max(...data.units.filter((other) => other.force).flatMap((other) => other.force));
    const { svg, x, y, bottom } = panel(`Pin forces at ${Math.max(...data.torque)} N m`, "pin number", "force (N)", pins, [0, largest], 860, 240);
    const width = Math.max(1, 0.7 * (x(1) - x(0)));
    unit.force.forEach((force, pin) => {
      if (force > 0) shape("rect", { x: x(pin) - width / 2, y: y(force), width, height: Math.max(0, y(0) - y(force)), class: "bar" }, svg);
    });
    shape("line", { x1: x(0), x2: x(pins.length - 1), y1: y(0), y2: y(0), class: "axis" }, svg);
    forceBox.replaceChildren(svg);
  };

  const choose = (number) => {
    chosen = (number + data.units.length) % data.units.length;
    tell();
    drawLoop();
    drawForces();
  };

  const drawScatter = () => {
    const across = data.metrics[horizontal], up = data.metrics[vertical];
    const within = (metric, values) => metric.limit === null ? values : [...values, metric.limit];
    const xs = data.units.map((unit) => unit.values[horizontal]), ys = data.units.map((unit) => unit.values[vertical]);
    const { svg, x, y, left, right, top, bottom } = panel(`${data.units.length} units`, axis(across), axis(up), within(across, xs), within(up, ys));
    if (across.limit !== null) shape("line", { x1: x(across.limit), x2: x(across.limit), y1: top, y2: bottom, class: "limit" }, svg);
    if (up.limit !== null) shape("line", { x1: left, x2: right, y1: y(up.limit), y2: y(up.limit), class: "limit" }, svg);
    dots = data.units.map((unit, number) => {
      const dot = shape("circle", { cx: x(xs[number]), cy: y(ys[number]), r: 4, class: unit.force ? "dot kept" : "dot" }, svg);
      dot.addEventListener("mouseenter", () => choose(number));
      dot.addEventListener("click", () => choose(number));
      return dot;
    });
    svg.setAttribute("tabindex", "0");
    svg.setAttribute("aria-label", `${data.units.length} units, ${across.title.toLowerCase()} and ${up.title.toLowerCase()}; arrow keys go from unit to unit`);
    svg.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (!step) return;
      event.preventDefault();
      const order = data.units.map((_, number) => number).sort((a, b) => xs[a] - xs[b]);
      choose(order[(order.indexOf(chosen) + step + order.length) % order.length]);
    });
    scatterBox.replaceChildren(svg);
    choose(chosen);
  };

  const select = (name, current, set) => {
    const label = document.createElement("label");
    const list = document.createElement("select");
    data.metrics.forEach((metric, number) => list.append(new Option(metric.title, number, false, number === current)));
    list.addEventListener("change", () => { set(Number(list.value)); drawScatter(); });
    label.append(`${name} `, list);
    return label;
  };

  const tools = document.createElement("div");
  tools.className = "tools";
  tools.append(select("Across", horizontal, (number) => { horizontal = number; }), select("Up", vertical, (number) => { vertical = number; }));
  const panels = document.createElement("div");
  panels.className = "panels";
  panels.append(scatterBox, loopBox, forceBox);
  const live = document.createElement("div");
  live.className = "live";
  live.append(tools, line, panels);
  static_picture.before(live);
  box.classList.add("questioned");
  drawScatter();
})();
