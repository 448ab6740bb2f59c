"use strict";
(() => {
  const root = document.documentElement;

  // Light or dark: the system's choice until the reader takes another.
  const button = document.getElementById("theme");
  const system = matchMedia("(prefers-color-scheme: dark)");
  const paint = (theme) => {
    root.dataset.theme = theme;
    button.textContent = theme === "dark" ? "Light page" : "Dark page";
  };
  button.hidden = false;
  button.addEventListener("click", () => paint(root.dataset.theme === "dark" ? "light" : "dark"));
  system.addEventListener("change", () => paint(system.matches ? "dark" : "light"));
  paint(system.matches ? "dark" : "light");

  // The contents: closed on a narrow page until they are asked for, and the section in sight is marked.
  const contents = document.querySelector("details.contents");
  const narrow = matchMedia("(max-width: 62rem)");
  const fold = () => { contents.open = !narrow.matches; };
  narrow.addEventListener("change", fold);
  fold();
  const links = new Map([...contents.querySelectorAll("a")].map((link) => [link.getAttribute("href").slice(1), link]));
  contents.addEventListener("click", (event) => { if (narrow.matches && event.target.closest("a")) contents.open = false; });
  const mark = () => {
    let current = null;
    for (const id of links.keys()) {
      const section = document.getElementById(id);
      if (section && section.getBoundingClientRect().top < innerHeight / 3) current = id;
    }
    for (const [id, link] of links) {
      if (id === current) link.setAttribute("aria-current", "true"); else link.removeAttribute("aria-current");
    }
  };
  addEventListener("scroll", mark, { passive: true });
  mark();

  // A table as tab-separated text: a number and its interval are columns of their own.
  const cellText = (cell) => {
    const copy = cell.cloneNode(true);
    copy.querySelectorAll(".ci").forEach((interval) => interval.remove());
    return copy.textContent.replace(/\s+/g, " ").trim();
  };
  const tableText = (table) => {
    const rows = [...table.rows].map((row) => [...row.cells].flatMap((cell) => {
      const texts = [cellText(cell), [...cell.querySelectorAll(".ci")].map((interval) => interval.textContent.trim()).join(" ")];
      return Array.from({ length: cell.colSpan }, (_, column) => column === 0 ? texts : ["", ""]);
    }));
    const width = Math.max(...rows.map((row) => row.length));
    const split = Array.from({ length: width }, (_, column) => rows.some((row) => row[column] && row[column][1]));
    return rows.map((row) => row.flatMap((texts, column) => split[column] ? texts : texts[0]).join("\t")).join("\n");
  };
  const copied = async (text) => {
    try {
      await navigator.clipboard.writeText(text);
      return true;
    } catch {
      const area = document.createElement("textarea");
      area.value = text;
      document.body.append(area);
      area.select();
      const done = document.execCommand("copy");
      area.remove();
      return done;
    }
  };
  for (const table of document.querySelectorAll(".scroll > table")) {
    const copy = document.createElement("button");
    copy.type = "button";
    copy.className = "copy";
    copy.textContent = "Copy table";
    copy.addEventListener("click", async () => {
      copy.textContent = await copied(tableText(table)) ? "Copied" : "Not copied";
      setTimeout(() => { copy.textContent = "Copy table"; }, 1500);
    });
    table.parentElement.before(copy);
    copy.tableText = () => tableText(table);
  }

  // What does not fit can be scrolled by keyboard.
  const reachable = () => {
    for (const box of document.querySelectorAll(".scroll, figure, pre")) {
      const wide = box.scrollWidth > box.clientWidth;
      if (!wide) { box.removeAttribute("tabindex"); box.removeAttribute("role"); box.removeAttribute("aria-label"); continue; }
      const caption = box.querySelector("caption, figcaption b");
      box.tabIndex = 0;
      if (!caption) continue;
      box.setAttribute("role", "region");
      box.setAttribute("aria-label", caption.textContent.trim());
    }
  };
  addEventListener("resize", reachable);
  reachable();

  // Panels of which one is shown at a time; on paper, and without this script, they stand below each other.
  for (const choice of document.querySelectorAll("[data-choice]")) {
    const panels = [...choice.querySelectorAll(":scope > [data-panel]")];
    if (panels.length < 2) continue;
    const bar = document.createElement("div");
    bar.className = "choice";
    bar.setAttribute("role", "group");
    bar.setAttribute("aria-label", choice.dataset.choice);
    const pick = (panel) => {
      panels.forEach((other, number) => {
        other.classList.toggle("unpicked", other !== panel);
        bar.children[number].setAttribute("aria-pressed", String(other === panel));
      });
      reachable();
    };
    for (const panel of panels) {
      const tab = document.createElement("button");
      tab.type = "button";
      tab.textContent = panel.dataset.panel;
      tab.addEventListener("click", () => pick(panel));
      bar.append(tab);
    }
    choice.prepend(bar);
    pick(panels[0]);
  }
})();
