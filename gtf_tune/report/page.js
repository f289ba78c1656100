"use strict";
(() => {
  const plots = [...document.querySelectorAll(".plot")];

  const buttonsOfPlots = [["toImage", "zoom2d", "pan2d", "resetScale2d"]];
  const buttonsOfScenes = [["toImage", "orbitRotation", "pan3d", "resetCameraDefault3d"]];

  const draw = (plot) => {
    if (plot.dataset.drawn) return;
    plot.dataset.drawn = "yes";
    const spec = JSON.parse(document.getElementById(plot.dataset.spec).textContent);
    Plotly.newPlot(plot, spec.data, { ...spec.layout, autosize: true }, {
      responsive: true,
      displaylogo: false,
      displayModeBar: "hover",
      modeBarButtons: spec.layout.scene ? buttonsOfScenes : buttonsOfPlots,
      toImageButtonOptions: { format: "svg", filename: plot.id },
    });
  };

  const margin = 800;
  const isNear = (plot) => plot.getBoundingClientRect().top < window.innerHeight + margin;
  plots.filter(isNear).forEach(draw);
  if ("IntersectionObserver" in window) {
    const observer = new IntersectionObserver(
      (entries) => entries.filter((entry) => entry.isIntersecting).forEach((entry) => {
        observer.unobserve(entry.target);
        draw(entry.target);
      }),
      { rootMargin: `${margin}px` },
    );
    plots.forEach((plot) => observer.observe(plot));
  } else {
    plots.forEach(draw);
  }
  window.addEventListener("beforeprint", () => {
    document.body.classList.add("printing");
    plots.forEach((plot) => {
      draw(plot);
      Plotly.relayout(plot, { width: plot.clientWidth });
    });
  });
  window.addEventListener("afterprint", () => {
    document.body.classList.remove("printing");
    plots.forEach((plot) => Plotly.relayout(plot, { width: null, autosize: true }));
  });

  document.querySelectorAll("button.copy").forEach((button) => {
    button.addEventListener("click", async () => {
      const code = button.closest("figure").querySelector("code");
      try {
        await navigator.clipboard.writeText(code.textContent);
        button.textContent = "copied";
      } catch {
        window.getSelection().selectAllChildren(code);
        button.textContent = "selected: press Ctrl-C";
      }
      setTimeout(() => { button.textContent = "copy"; }, 2000);
    });
  });
})();
