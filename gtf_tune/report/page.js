"use strict";
(async () => {
  const plots = [...document.querySelectorAll(".plot")];
  const darkColours = Object.entries(JSON.parse(document.getElementById("dark-colours").textContent));
  const darkScheme = window.matchMedia("(prefers-color-scheme: dark)");
  let isPrinting = false;

  // plotly.js is packed, which makes the page a third as large.
  const unpack = async (packed) => {
    const bytes = Uint8Array.from(atob(packed), (character) => character.charCodeAt(0));
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
  };
  const library = document.getElementById("plotly");
  if (!("DecompressionStream" in window)) {
    document.getElementById("too-old").hidden = false;
    return;
  }
  const script = document.createElement("script");
  script.textContent = await unpack(library.textContent.trim());
  library.replaceWith(script);

  const buttonsOfPlots = [["toImage", "zoom2d", "pan2d", "resetScale2d"]];
  const buttonsOfScenes = [["toImage", "orbitRotation", "pan3d", "resetCameraDefault3d"]];

  const specOf = (plot) => {
    let text = document.getElementById(plot.dataset.spec).textContent;
    if (darkScheme.matches && !isPrinting) {
      darkColours.forEach(([light, dark]) => { text = text.replaceAll(`"${light}"`, `"${dark}"`); });
    }
    return JSON.parse(text);
  };
  const show = async (plot) => {
    plot.dataset.drawn = "yes";
    const spec = specOf(plot);
    const drawn = await Plotly.react(plot, spec.data, { ...spec.layout, autosize: true }, {
      responsive: true,
      displaylogo: false,
      displayModeBar: window.matchMedia("(min-width: 700px)").matches ? "hover" : false,
      modeBarButtons: spec.layout.scene ? buttonsOfScenes : buttonsOfPlots,
      toImageButtonOptions: { format: "svg", filename: plot.id },
    });
    if (isLinked(plot) && !plot.dataset.turns) {
      plot.dataset.turns = "yes";
      plot.on("plotly_relayout", (change) => turnOthers(plot, change));
    }
    return drawn;
  };
  // Scenes that are linked turn together.
  const isLinked = (plot) => plot.layout && plot.layout.meta === "linked";
  let isTurning = false;
  const turnOthers = async (plot, change) => {
    const camera = change["scene.camera"];
    if (!camera || isTurning) return;
    isTurning = true;
    const others = plots.filter((other) => other !== plot && isLinked(other));
    await Promise.all(others.map((other) => Plotly.relayout(other, { "scene.camera": camera })));
    isTurning = false;
  };
  const showOnce = (plot) => { if (!plot.dataset.drawn) show(plot); };

  const margin = 800;
  const isNear = (plot) => plot.getBoundingClientRect().top < window.innerHeight + margin;
  plots.filter(isNear).forEach(showOnce);
  const observer = new IntersectionObserver(
    (entries) => entries.filter((entry) => entry.isIntersecting).forEach((entry) => {
      observer.unobserve(entry.target);
      showOnce(entry.target);
    }),
    { rootMargin: `${margin}px` },
  );
  plots.forEach((plot) => observer.observe(plot));
  darkScheme.addEventListener("change", () => plots.filter((plot) => plot.dataset.drawn).forEach(show));

  window.addEventListener("beforeprint", () => {
    isPrinting = true;
    document.body.classList.add("printing");
    plots.forEach((plot) => {
      show(plot);
      Plotly.relayout(plot, { width: plot.clientWidth });
    });
  });
  window.addEventListener("afterprint", () => {
    isPrinting = false;
    document.body.classList.remove("printing");
    plots.forEach((plot) => {
      show(plot);
      Plotly.relayout(plot, { width: null, autosize: true });
    });
  });

  document.querySelectorAll("button.copy").forEach((button) => {
    button.addEventListener("click", async () => {
      const code = button.closest("figure").querySelector("code");
      try {
        await navigator.clipboard.writeText(code.textContent);
        button.firstChild.textContent = "copied";
      } catch {
        window.getSelection().selectAllChildren(code);
        button.firstChild.textContent = "selected: press Ctrl-C";
      }
      setTimeout(() => { button.firstChild.textContent = "copy"; }, 2000);
    });
  });
})();
