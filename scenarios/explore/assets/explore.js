/* What the page does by itself: words beside sliders, and one request at a time, the last wins. */
(function () {
  "use strict";
  const NAMES = ["albedo", "sigma_t_per_mm", "g", "thickness_mm", "n", "rho_black", "rho_white",
    "acceptance_deg", "averages"];
  const state = { ready: false, wavelength: 0, busy: false, number: 0, pending: null, drawn: {} };
  const same = () => window.dash_clientside.no_update;

  function value(slider, position) {
    let found = position;
    if (slider.scale === "logarithm") { found = Math.pow(10, position); }
    if (slider.scale === "albedo") { found = 1 - Math.pow(10, -position); }
    return Math.min(Math.max(found, slider.low), slider.high);
  }

  function position(slider, found) {
    const inside = Math.min(Math.max(found, slider.low), slider.high);
    if (slider.scale === "logarithm") { return Math.log10(inside); }
    return slider.scale === "albedo" ? -Math.log10(1 - inside) : inside;
  }

  /* How a spectrum moves as a whole (moves.py): what was `base` is `now`; what becomes of `there`. */
  function share(base, now, there) {
    if (!(base > 0 && base < 1 && now > 0 && now < 1)) { return now; }
    const odds = (now * (1 - base) / ((1 - now) * base)) * there;
    return odds / (1 - there + odds);
  }
  const scale = (base, now, there) => (base > 0 ? there * now / base : now);
  const MOVES = {
    albedo: share,
    sigma_t_per_mm: scale,
    g: (base, now, there) => 2 * share((1 + base) / 2, (1 + now) / 2, (1 + there) / 2) - 1,
    n: (base, now, there) => 1 + scale(base - 1, now - 1, there - 1),
    rho_black: share,
    rho_white: share,
  };

  function written(slider, position) {
    const found = value(slider, position);
    let text = found.toFixed(slider.digits);
    if (slider.unit === "frames") { text = String(Math.round(found)); }
    else if (slider.scale === "logarithm") { text = String(Number(found.toPrecision(slider.digits))); }
    return slider.unit === "" ? text : text + (slider.unit === "°" ? "°" : " " + slider.unit);
  }

  function send(request) {
    state.busy = true;
    state.pending = null;
    state.number += 1;
    fetch("picture", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(Object.assign({}, request, { number: state.number })),
    })
      .then((response) => {
        if (!response.ok) { throw new Error("the program answered " + response.status); }
        return response.json();
      })
      .then(draw)
      .catch((error) => { say("No picture: " + error.message + ". Is the program still running?"); })
      .finally(() => {
        state.busy = false;
        if (state.pending !== null) { send(state.pending); }
      });
  }

  function say(text) { document.getElementById("status").textContent = text; }

  function write(pieces) {
    Object.keys(pieces).forEach((id) => { document.getElementById(id).innerHTML = pieces[id]; });
  }

  function unchanged(id, figure) {
    const text = JSON.stringify(figure);
    const as_before = state.drawn[id] === text;
    state.drawn[id] = text;
    return as_before;
  }

  function draw(answer) {
    say(answer.said);
    if (answer.said !== "") { return; }
    write(answer.pieces);
    Object.keys(answer.figures).forEach((id) => {
      if (unchanged(id, answer.figures[id])) { return; }
      const graph = document.querySelector("#" + id + " .js-plotly-plot");
      const figure = answer.figures[id];
      window.Plotly.react(graph, figure.data, figure.layout, graph._context);
    });
  }

  /* what stands beside the sliders */
  function label(bases, wavelength, positions) {
    const put = (name, text) => {
      document.getElementById(name + "-value").textContent = text;
      const thumb = document.querySelector("#" + name + " [role=slider]");
      if (thumb !== null) {
        thumb.setAttribute("aria-label", thumb.closest(".slider").querySelector("label").textContent);
        thumb.setAttribute("aria-valuetext", text);
      }
    };
    put("wavelength", Math.round(bases.wavelength_nm[wavelength]) + " nm");
    NAMES.forEach((name, k) => put(name, written(bases.sliders[name], positions[k])));
  }

  window.dash_clientside = Object.assign({}, window.dash_clientside, {
    explore: {
      choose: function (material, sample, wavelength, clicks, bases, ...positions) {
        const why = window.dash_clientside.callback_context.triggered_id;
        const found = {};
        if (why === "wavelength") {
          Object.keys(MOVES).forEach((name) => {
            const slider = bases.sliders[name];
            const own = name in bases.described ? bases.described : bases.materials[material];
            const at = (index) => value(slider, own[name][index]);
            const now = value(slider, positions[NAMES.indexOf(name)]);
            found[name] = position(slider, MOVES[name](at(state.wavelength), now, at(wavelength)));
          });
        }
        state.wavelength = wavelength;
        if (why === "material" || why === "reset") {
          const own = bases.materials[material];
          Object.keys(own).forEach((name) => { found[name] = own[name][wavelength]; });
        }
        if (why === "sample" || why === "reset") { found.thickness_mm = bases.thickness_mm[sample]; }
        if (why === "reset") {
          Object.keys(bases.described).forEach((name) => {
            found[name] = bases.described[name][wavelength];
          });
          found.acceptance_deg = bases.acceptance_deg;
          found.averages = bases.averages;
        }
        return [...NAMES.map((name) => (name in found ? found[name] : same())), Date.now()];
      },

      ask: function (moved, ticks, ...rest) {
        const [material, sample, wavelength, bases] = rest.slice(NAMES.length);
        label(bases, wavelength, rest);
        if (!state.ready) {  // the first picture came with the page
          state.ready = true;
          state.wavelength = wavelength;
          write(bases.answer.pieces);
          Object.keys(bases.answer.figures).forEach((id) => unchanged(id, bases.answer.figures[id]));
          return same();
        }
        const request = {
          material, sample, wavelength,
          all_samples: ticks.includes("all_samples"), drift: ticks.includes("drift"),
        };
        NAMES.forEach((name, k) => { request[name] = rest[k]; });
        if (state.busy) { state.pending = request; } else { send(request); }
        return same();
      },

      turn: function (title) {
        document.querySelectorAll(".sheet").forEach((sheet) => {
          sheet.hidden = sheet.dataset.title !== title;
        });
        window.dispatchEvent(new Event("resize"));
        return title;
      },
    },
  });
})();
