"use strict";
(function () {
  const holder = document.getElementById("data");
  const data = holder ? JSON.parse(holder.textContent) : {};
  const el = (id) => document.getElementById(id);
  const root = document.documentElement;

  // Light, dark, or as the reader's system has it; paper is always light.
  const system = window.matchMedia("(prefers-color-scheme: dark)");
  let chosen = null;
  function theme(dark) {
    root.dataset.theme = dark ? "dark" : "light";
    if (el("theme")) el("theme").textContent = dark ? "Light" : "Dark";
    if (redraw) redraw();
  }
  let redraw = null;
  const asked = () => (chosen === null ? system.matches : chosen);
  theme(asked());
  system.addEventListener("change", () => theme(asked()));
  if (el("theme")) el("theme").addEventListener("click", () => { chosen = !asked(); theme(chosen); });
  let paper = null;
  window.addEventListener("beforeprint", () => { theme(false); if (paper) paper(true); });
  window.addEventListener("afterprint", () => { if (paper) paper(false); theme(asked()); });

  const box = el("map");
  const map = box && data.map ? draw(box, data.map) : null;
  if (data.frames && data.frames.length) slider(data.frames, map);
  root.dataset.ready = "yes";

  // Lines are whole numbers of 1e-5 degrees: longitude and latitude, first absolute, then steps.
  function line(code) {
    const points = [];
    let x = 0, y = 0;
    for (let k = 0; k < code.length; k += 2) {
      x += code[k]; y += code[k + 1];
      points.push([y / 1e5, x / 1e5]);
    }
    return points;
  }
  function shapes(polygons) { return polygons.map((rings) => rings.map(line)); }

  function words(text) {
    const node = document.createElement("div");
    node.textContent = text;
    return node;
  }
  function pin(kind, text, size) {
    const node = document.createElement("span");
    node.textContent = text;
    return L.divIcon({ className: "pin " + kind, html: node, iconSize: [size, size], iconAnchor: [size / 2, size / 2] });
  }
  function marker(place, kind, text, size, told, level) {
    const made = L.marker(place, { icon: pin(kind, text, size), zIndexOffset: level || 0, keyboard: Boolean(told),
      title: "", alt: told ? told.split("\n")[0] : "" });
    if (told) made.bindTooltip(words(told), { direction: "top", offset: [0, -size / 2] });
    return made;
  }

  function draw(node, given) {
    const chart = L.map(node, { attributionControl: false, zoomSnap: 0.25, zoomDelta: 0.5, wheelPxPerZoomLevel: 120,
      maxBoundsViscosity: 0.8, fadeAnimation: false, minZoom: 1, maxZoom: 18 });
    ["sea", "density", "lines", "arrows", "regions", "paths"].forEach((name, k) => {
      chart.createPane(name).style.zIndex = 210 + 30 * k;
      if (name !== "regions") chart.getPane(name).style.pointerEvents = "none";
    });
    chart.fitBounds(given.bounds, { animate: false });
    L.control.scale({ imperial: false, maxWidth: 140 }).addTo(chart);
    const layers = {};
    const group = (name) => (layers[name] = L.layerGroup().addTo(chart));

    const sea = group("sea");
    const flat = { stroke: false, fillOpacity: 1, interactive: false, pane: "sea", smoothFactor: 0.7 };
    (given.bands || []).forEach((band, k) => {
      L.polygon(shapes(band), { ...flat, className: "sea" + Math.min(k, 8) }).addTo(sea);
    });
    if (given.land) {
      L.polygon(shapes(given.land), { ...flat, className: "land" }).addTo(sea);
      L.polyline(given.shore.map(line), { pane: "lines", className: "shore", weight: 1.3, interactive: false }).addTo(sea);
    }
    (given.contours || []).forEach((one) => {
      L.polyline(one.lines.map(line), { pane: "lines", className: "contour", weight: 0.8, interactive: false }).addTo(sea);
      one.labels.forEach((place) => L.marker(place, { interactive: false, keyboard: false, icon: L.divIcon({
        className: "depth", html: words(one.depth + " m"), iconSize: [44, 14] }) }).addTo(sea));
    });

    const places = group("places");
    if (given.path) {
      L.polyline(line(given.path), { pane: "paths", className: "path", weight: 2, dashArray: "2 5", interactive: false })
        .addTo(places);
    }
    (given.pins || []).forEach((one) => marker(one.place, one.kind, one.label, one.size || 24, one.told, one.level).addTo(places));
    const surfaced = group("surfacings");
    (given.surfacings || []).forEach((one) => {
      one.regions.forEach((part, k) => L.polygon(shapes(part), { pane: "regions", className: k ? "up90" : "up50",
        weight: k ? 1.2 : 1.8, fillOpacity: k ? 0 : 0.15, interactive: false }).addTo(surfaced));
      marker(one.place, "up", one.label, 20, one.told, 400).addTo(surfaced);
    });

    const density = group("density"), arrows = group("arrows"), regions = group("regions");
    let picture = null;
    const cells = given.density;
    function paint(frame) {
      density.clearLayers();
      const counts = cells && frame !== null ? cells.frames[frame] : null;
      if (!counts || !counts.length) return;
      const canvas = picture || (picture = document.createElement("canvas"));
      canvas.width = cells.columns; canvas.height = cells.rows;
      const pen = canvas.getContext("2d"), image = pen.createImageData(cells.columns, cells.rows);
      const dark = root.dataset.theme === "dark", ramp = cells.ramp, top = Math.log1p(cells.most);
      for (let k = 0, at = 0; k < counts.length; k += 2) {
        at += counts[k];
        const share = Math.min(Math.log1p(counts[k + 1]) / top, 1);
        const colour = ramp[Math.round((dark ? share : 1 - share) * (ramp.length - 1))];
        // Rows count from the south; pictures from the top.
        const i = 4 * ((cells.rows - 1 - Math.floor(at / cells.columns)) * cells.columns + (at % cells.columns));
        image.data[i] = colour[0]; image.data[i + 1] = colour[1]; image.data[i + 2] = colour[2];
        image.data[i + 3] = 110 + 135 * share;
      }
      pen.putImageData(image, 0, 0);
      L.imageOverlay(canvas.toDataURL(), cells.bounds, { pane: "density", className: "density", alt: "" }).addTo(density);
    }
    function ramp() {
      if (!cells || !el("ramp")) return;
      const pick = (share) => "rgb(" + cells.ramp[Math.round(share * (cells.ramp.length - 1))].join(",") + ")";
      el("ramp").style.background = "linear-gradient(90deg," + [1, 0.75, 0.5, 0.25, 0].map((s) => pick(
        root.dataset.theme === "dark" ? 1 - s : s)).join(",") + ")";
    }
    function flow(frame) {
      arrows.clearLayers();
      const field = given.currents;
      const values = field && frame !== null ? field.frames[Math.min(frame, field.frames.length - 1)] : null;
      if (!values) return;
      const parts = [];
      for (let k = 0; k < field.places.length; k += 2) {
        const east = values[k], north = values[k + 1];
        if (east === null || (east === 0 && north === 0)) continue;
        const lon = field.places[k] / 1e4, lat = field.places[k + 1] / 1e4, wide = Math.cos(lat * Math.PI / 180);
        const dy = north * field.scale, dx = east * field.scale;
        const tail = [lat - dy / 2, lon - dx / 2 / wide], tip = [lat + dy / 2, lon + dx / 2 / wide];
        const head = (turn) => {
          const c = Math.cos(turn) * 0.26, s = Math.sin(turn) * 0.26;
          return [tip[0] - (dy * c - dx * s), tip[1] - (dx * c + dy * s) / wide];
        };
        parts.push([tail, tip], [head(0.42), tip, head(-0.42)]);
      }
      L.polyline(parts, { pane: "arrows", className: "arrow", weight: 1, opacity: 0.65, interactive: false,
        smoothFactor: 0, noClip: true }).addTo(arrows);
    }
    let last = null;
    function show(frame, k) {
      last = [frame, k];
      regions.clearLayers();
      paint(frame.cells === undefined ? k : frame.cells);
      flow(frame.flow === undefined ? k : frame.flow);
      (frame.regions || []).slice().reverse().forEach((part, j) => {
        const inner = j === frame.regions.length - 1;
        L.polygon(shapes(part), { pane: "regions", className: inner ? "r50" : "r90", weight: inner ? 2.4 : 1.6,
          dashArray: inner ? null : "6 4", fillOpacity: inner ? 0.16 : 0.07, interactive: false }).addTo(regions);
      });
      if (frame.join) L.polyline(frame.join, { pane: "paths", className: "error", weight: 1.6, interactive: false }).addTo(regions);
      if (frame.truth) marker(frame.truth, "truth", "", 13, frame.toldTruth, 600).addTo(regions);
      if (frame.place) marker(frame.place, "place", "", 13, frame.told, 500).addTo(regions);
      if (frame.look) chart.fitBounds(frame.look, { animate: false, maxZoom: 14 });
    }
    redraw = () => { ramp(); if (last) show(...last); };
    ramp();
    // On paper the map has the width of the paper and shows what the screen showed.
    paper = (on) => {
      const view = chart.getBounds();
      node.style.width = on ? "680px" : "";
      node.style.height = on ? "430px" : "";
      chart.invalidateSize({ animate: false });
      chart.fitBounds(view, { animate: false });
    };

    document.querySelectorAll("input[data-layer]").forEach((box) => box.addEventListener("change", () => {
      const layer = layers[box.dataset.layer];
      if (box.checked) layer.addTo(chart); else layer.remove();
    }));
    if (el("whole")) el("whole").addEventListener("click", () => chart.fitBounds(given.bounds));
    if (el("near") && given.near) el("near").addEventListener("click", () => chart.fitBounds(given.near, { maxZoom: 15 }));
    graticule(chart);
    return { show, chart };
  }

  function angle(value, names, minutes) {
    const total = Math.round(Math.abs(value) * 60 * Math.pow(10, minutes)) / Math.pow(10, minutes);
    const whole = Math.floor(total / 60), rest = (total - 60 * whole).toFixed(minutes);
    return whole + "°" + rest.padStart(minutes ? minutes + 3 : 2, "0") + "′" + names[value < 0 ? 1 : 0];
  }
  function wrap(lon) { return ((lon + 180) % 360 + 360) % 360 - 180; }
  function graticule(chart) {
    const lines = L.layerGroup().addTo(chart);
    const steps = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 1200, 2700];
    function refresh() {
      lines.clearLayers();
      const view = chart.getBounds(), size = chart.getSize();
      const span = (view.getEast() - view.getWest()) * 60 / Math.max(size.x / 150, 2);
      const step = (steps.find((one) => one >= span) || 2700) / 60, digits = step * 60 < 1 ? 1 : 0;
      const add = (points, place, text, anchor) => {
        L.polyline(points, { pane: "lines", className: "grat", weight: 1, interactive: false }).addTo(lines);
        L.marker(place, { interactive: false, keyboard: false, icon: L.divIcon({ className: "gratlabel", html: words(text),
          iconSize: [70, 14], iconAnchor: anchor }) }).addTo(lines);
      };
      const foot = chart.containerPointToLatLng([0, 12]).lat, side = chart.containerPointToLatLng([size.x - 74, 0]).lng;
      for (let x = Math.ceil(view.getWest() / step); x * step < view.getEast(); x++) {
        add([[view.getSouth(), x * step], [view.getNorth(), x * step]], [foot, x * step], angle(wrap(x * step), "EW", digits), [-3, 8]);
      }
      for (let y = Math.ceil(view.getSouth() / step); y * step < view.getNorth(); y++) {
        add([[y * step, view.getWest()], [y * step, view.getEast()]], [y * step, side], angle(y * step, "NS", digits), [-14, 14]);
      }
    }
    chart.on("moveend", refresh);
    refresh();
    const place = L.control({ position: "bottomright" });
    const text = L.DomUtil.create("div", "readout no-print");
    place.onAdd = () => text;
    place.addTo(chart);
    chart.on("mousemove", (event) => {
      const lat = event.latlng.lat, lon = wrap(event.latlng.lng);
      text.textContent = lat.toFixed(4) + ", " + lon.toFixed(4) + "   " + angle(lat, "NS", 2) + " " + angle(lon, "EW", 2);
    });
    chart.on("mouseout", () => { text.textContent = ""; });
  }

  function slider(frames, shown) {
    const range = el("time");
    let timer = null;
    function show(k) {
      const frame = frames[k];
      range.value = k;
      range.setAttribute("aria-valuetext", frame.when);
      el("when").textContent = frame.when;
      el("told").textContent = frame.told;
      if (shown) shown.show(frame, k);
      document.querySelectorAll("svg.chart .cursor").forEach((cursor) => {
        const svg = cursor.ownerSVGElement, d = svg.dataset;
        const x = Number(d.left) + (frame.share || 0) * Number(d.wide);
        cursor.setAttribute("x1", x); cursor.setAttribute("x2", x);
      });
      document.querySelectorAll("tr[data-frame]").forEach((row) => {
        row.classList.toggle("now", Number(row.dataset.frame) === k);
      });
    }
    const step = (by) => show((Number(range.value) + by + frames.length) % frames.length);
    range.addEventListener("input", () => show(Number(range.value)));
    el("back").addEventListener("click", () => step(-1));
    el("on").addEventListener("click", () => step(1));
    el("play").addEventListener("click", () => {
      if (timer) { clearInterval(timer); timer = null; } else timer = setInterval(() => step(1), 700);
      el("play").textContent = timer ? "Pause" : "Play";
    });
    document.querySelectorAll("tr[data-frame]").forEach((row) => row.addEventListener("click", () => show(Number(row.dataset.frame))));
    show(Number(range.value));
  }
})();
