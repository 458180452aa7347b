// The map: where each query of a test day was taken, what a method answered, and what was seen at both ends.
(() => {
  const get = (name) => document.getElementById(`map-${name}`);
  const canvas = get("canvas"), pen = canvas.getContext("2d");
  const choices = Object.fromEntries(["study", "method", "sequence", "by"].map((name) => [name, get(name)]));
  if (!choices.study.options.length) return;
  document.getElementById("mapped").hidden = false;

  const NONE = 0xffff, GREY = "#9a9a96";
  const QUIET = { name: "not judged", colour: "#c9c8c2", says: "between seen and unseen" };
  const SAYS = ["accepted, and right", "rejected although seen", "accepted, and wrong or unseen", "rejected, and unseen"];
  const unpack = (text, type) => new type(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
  const make = (name, text = "", attributes = {}) => Object.assign(document.createElement(name), { textContent: text }, attributes);
  const loaded = new Map(), pictures = new Map();
  let study, day, said, kinds, chosen = -1, view, points = [];

  const parsed = (name) => {
    if (!loaded.has(name)) {
      const told = JSON.parse(document.getElementById(name).textContent);
      told.path = unpack(told.path, Float32Array);
      loaded.set(name, told);
    }
    return loaded.get(name);
  };
  const picture = (atlas) => {
    if (!pictures.has(atlas)) {
      const image = new Image();
      pictures.set(atlas, new Promise((done) => { image.onload = () => done(image); }));
      image.src = `data:image/png;base64,${atlas.png}`;
    }
    return pictures.get(atlas);
  };
  const refill = (select, options, wanted) => {
    select.replaceChildren(...options.map(([value, label]) => make("option", label, { value })));
    if (options.some(([value]) => value === wanted)) select.value = wanted;
  };

  function chooseStudy() {
    study = parsed(choices.study.value);
    refill(choices.method, Object.keys(study.answers).map((name) => [name, name]), study.best);
    refill(choices.sequence, study.sequences.map((one, i) => [String(i), one.label]), "0");
    get("simulated").hidden = !study.simulated;
    chosen = -1;
    chooseDay();
    showAll();
  }
  function chooseDay() {
    const raw = study.sequences[+choices.sequence.value];
    const answer = study.answers[choices.method.value][raw.name];
    day = { atlas: raw.atlas };
    for (const name of ["xy", "heading", "nearest_m"]) day[name] = unpack(raw[name], Float32Array);
    for (const name of ["row", "turned"]) day[name] = unpack(raw[name], Uint16Array);
    said = { kind: answer.kind, threshold: answer.threshold };
    for (const name of ["xy", "novelty"]) said[name] = unpack(answer[name], Float32Array);
    for (const name of ["row", "turned"]) said[name] = unpack(answer[name], Uint16Array);
    said.heading = answer.heading && unpack(answer.heading, Float32Array);
    for (const by of ["distance", "cells"]) {
      said[by] = { outcome: unpack(answer[by].outcome, Int8Array), rank: unpack(answer[by].rank, Int16Array), seen: unpack(answer[by].seen, Uint8Array) };
    }
    if (chosen >= day.nearest_m.length) chosen = -1;
    colour();
  }
  function colour() {
    const [hit, , alarm, turnedAway] = study.outcomes, by = choices.by.value;
    const first = [
      { name: "right", colour: hit.colour, says: `within ${study.correct_m} m` },
      { name: "wrong", colour: alarm.colour, says: "seen, but placed elsewhere", wrong: true },
      { name: "unseen", colour: turnedAway.colour, says: "no answer could be right" }, QUIET];
    const outcomes = [...study.outcomes.map((one, i) => ({ ...one, says: SAYS[i], wrong: i === 1 || i === 2 })), QUIET];
    kinds = by === "answer" ? first : outcomes;
    const { outcome, rank, seen } = said[by === "answer" ? "distance" : by];
    points = Array.from(outcome, (code, i) => by !== "answer" ? code : code === 4 ? 3 : !seen[i] ? 2 : rank[i] === 0 ? 0 : 1);
    const counts = kinds.map((_, kind) => points.filter((one) => one === kind).length);
    const swatch = (tint, kind) => Object.assign(make("i", "", { className: kind }), { style: `background: ${tint}` });
    const items = kinds.map((kind, i) => [kind, counts[i]]).filter(([kind, count]) => count || kind !== QUIET).map(([kind, count]) => {
      const item = make("li", "", { title: kind.says });
      item.append(swatch(kind.colour, ""), `${kind.name} ${count}`);
      return item;
    });
    const path = make("li");
    path.append(swatch("#cfcec8", "line"), "training path");
    get("legend").replaceChildren(...items, path);
    choose(chosen);
  }

  function showAll() {
    const xs = [], ys = [];
    for (const places of [study.path, day.xy]) places.forEach((value, i) => (i % 2 ? ys : xs).push(value));
    const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    const box = canvas.getBoundingClientRect();
    const scale = Math.min((box.width - 56) / Math.max(right - left, 1), (box.height - 56) / Math.max(high - low, 1));
    view = { x: (left + right) / 2, y: (low + high) / 2, scale, least: scale / 2 };
    draw();
  }
  const onScreen = (x, y, box) => [box.width / 2 + (x - view.x) * view.scale, box.height / 2 - (y - view.y) * view.scale];
  function zoom(by, at) {
    const box = canvas.getBoundingClientRect();
    const [dx, dy] = at ? [at.x - box.width / 2, box.height / 2 - at.y] : [0, 0];
    const scale = Math.min(Math.max(view.scale * by, view.least), 200);
    view.x += dx / view.scale - dx / scale;
    view.y += dy / view.scale - dy / scale;
    view.scale = scale;
    draw();
  }
  function draw() {
    const box = canvas.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
    if (!box.width || !view) return;
    canvas.width = Math.round(box.width * ratio);
    canvas.height = Math.round(box.height * ratio);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, box.width, box.height);
    pen.lineJoin = pen.lineCap = "round";
    pen.strokeStyle = "#cfcec8";
    pen.lineWidth = 4;
    pen.beginPath();
    for (let i = 0; i < study.path.length; i += 2) {
      const jump = i && Math.hypot(study.path[i] - study.path[i - 2], study.path[i + 1] - study.path[i - 1]) > 30;
      pen[i && !jump ? "lineTo" : "moveTo"](...onScreen(study.path[i], study.path[i + 1], box));
    }
    pen.stroke();
    const size = Math.min(Math.max(1.1 * view.scale, 2.6), 7);
    for (let kind = kinds.length - 1; kind >= 0; kind--) { // what went wrong on top
      for (const last of [false, true]) {
        if (last !== Boolean(kinds[kind].wrong)) continue;
        pen.fillStyle = kinds[kind].colour;
        points.forEach((one, i) => {
          if (one !== kind) return;
          pen.beginPath();
          pen.arc(...onScreen(day.xy[2 * i], day.xy[2 * i + 1], box), size, 0, 2 * Math.PI);
          pen.fill();
        });
      }
    }
    if (chosen >= 0) drawChosen(box, size);
    drawScale(box);
  }
  function drawChosen(box, size) {
    const from = onScreen(day.xy[2 * chosen], day.xy[2 * chosen + 1], box);
    pen.strokeStyle = pen.fillStyle = "#111";
    if (said.row[chosen] !== NONE) {
      const to = onScreen(said.xy[2 * chosen], said.xy[2 * chosen + 1], box);
      pen.lineWidth = 1.6;
      pen.beginPath();
      pen.moveTo(...from);
      pen.lineTo(...to);
      pen.stroke();
      pen.beginPath();
      pen.moveTo(to[0], to[1] - 6);
      pen.lineTo(to[0] + 6, to[1]);
      pen.lineTo(to[0], to[1] + 6);
      pen.lineTo(to[0] - 6, to[1]);
      pen.fill();
    }
    pen.lineWidth = 2;
    pen.beginPath();
    pen.arc(...from, size + 4, 0, 2 * Math.PI);
    pen.stroke();
  }
  function drawScale(box) {
    const wanted = 130 / view.scale, power = 10 ** Math.floor(Math.log10(wanted));
    const length = Math.max(...[1, 2, 5].map((step) => step * power).filter((step) => step <= wanted));
    pen.strokeStyle = pen.fillStyle = "#333";
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(14, box.height - 14);
    pen.lineTo(14 + length * view.scale, box.height - 14);
    pen.stroke();
    pen.font = "12px sans-serif";
    pen.fillText(`${length} m`, 14, box.height - 20);
  }

  const metres = (value) => `${value.toFixed(value < 9.95 ? 1 : 0)} m`;
  const degrees = (value) => `${Math.round(value)}°`.replace("-", "−");
  const around = (value) => 180 - ((((180 - value) % 360) + 360) % 360);
  function facts(i) {
    const kind = kinds[points[i]], by = choices.by.value === "cells" ? "cells" : "distance", rank = said[by].rank[i];
    const off = Math.hypot(said.xy[2 * i] - day.xy[2 * i], said.xy[2 * i + 1] - day.xy[2 * i + 1]);
    const rejects = said.novelty[i] >= said.threshold;
    const limit = said.threshold < -1e38 ? "the model rejects everything" : said.threshold > 1e38 ? "the model accepts everything"
      : `${rejects ? "rejected" : "accepted"}: threshold ${said.threshold.toPrecision(3)}`;
    const heading = said.heading && isFinite(said.heading[i]) ? `${degrees(said.heading[i])}, true ${degrees(day.heading[i])}, `
      + `off by ${degrees(Math.abs(around(said.heading[i] - day.heading[i])))}` : `not told; true ${degrees(day.heading[i])}`;
    return [
      ["Outcome", `${kind.name}: ${kind.says}`],
      ["Error", said.row[i] === NONE ? "no position was told" : `${metres(off)} from query to answer`],
      ["Novelty", `${said.novelty[i].toPrecision(3)} (${said.kind.replaceAll("_", " ")}); ${limit}`],
      ["Heading", heading],
      ["Right place", !said[by].seen[i] ? `none: ${kind === QUIET ? "not judged" : "unseen"}` : rank < 0 ? `not ranked, by ${by}` : `rank ${rank + 1}, by ${by}`],
      ["Training pose", `${metres(day.nearest_m[i])} away at the nearest`],
    ];
  }
  function choose(i) {
    chosen = i;
    const told = get("told");
    if (i < 0) {
      told.replaceChildren(make("p", "Choose a query on the map, or step along the drive."));
      get("views").replaceChildren();
      return draw();
    }
    const list = make("dl");
    for (const [name, value] of facts(i)) {
      const line = make("div");
      line.append(make("dt", name), make("dd", value));
      list.append(line);
    }
    told.replaceChildren(make("h3", `Query ${i + 1} of ${points.length}`), list);
    showViews(i);
    draw();
  }
  function showViews(i) {
    if (!day.atlas) return get("views").replaceChildren(make("p", "No method of this study looks at Scan Contexts, so no view is shown.", { className: "quiet" }));
    const nearest = day.row[i] !== said.row[i] && day.nearest_m[i] <= study.correct_m;
    const rolled = (turned) => turned ? `, rolled by ${degrees(around(turned * 360 / day.atlas.sectors))} to look most like the query` : "";
    const shown = [[day.atlas, i, 0, "The query"]];
    if (said.row[i] !== NONE) shown.push([study.train, said.row[i], said.turned[i], `Training view nearest to the answer${rolled(said.turned[i])}`]);
    if (nearest) shown.push([study.train, day.row[i], day.turned[i], `Training view nearest to where it truly is${rolled(day.turned[i])}`]);
    const figures = shown.map(([atlas, row, turned, caption]) => {
      const figure = make("figure", "", { className: "view" });
      const image = make("canvas", "", { width: atlas.sectors, height: atlas.rings });
      image.setAttribute("role", "img");
      image.setAttribute("aria-label", caption);
      figure.append(image, make("figcaption", caption));
      picture(atlas).then((sheet) => paint(image.getContext("2d"), sheet, atlas, row, turned));
      return figure;
    });
    const note = "Scan Contexts, whatever the method looks at: azimuth to the right from straight ahead over the left, range upwards to 80 m, "
      + "heights from blue (0 m) to red (15 m).";
    get("views").replaceChildren(...figures, make("p", note, { className: "quiet" }));
  }
  function paint(brush, sheet, atlas, row, turned) {
    const { rings, sectors, columns } = atlas;
    const left = (row % columns) * sectors, top = Math.floor(row / columns) * rings, rest = sectors - turned;
    brush.imageSmoothingEnabled = false;
    brush.setTransform(1, 0, 0, -1, 0, rings); // the nearest ring at the bottom
    brush.drawImage(sheet, left, top, rest, rings, turned, 0, rest, rings);
    if (turned) brush.drawImage(sheet, left + rest, top, turned, rings, 0, 0, turned, rings);
  }
  function step(by, wanted = () => true) {
    const count = points.length;
    for (let n = 1, i = chosen < 0 && by < 0 ? 0 : chosen; n <= count; n++) {
      i = (i + by + count) % count;
      if (wanted(i)) return follow(i);
    }
  }
  function follow(i) { // keep the chosen query in sight
    const box = canvas.getBoundingClientRect(), [x, y] = onScreen(day.xy[2 * i], day.xy[2 * i + 1], box);
    if (x < 20 || y < 20 || x > box.width - 20 || y > box.height - 20) [view.x, view.y] = [day.xy[2 * i], day.xy[2 * i + 1]];
    choose(i);
  }

  const fingers = new Map();
  let moved = 0, spread = 0;
  const at = (event) => ({ x: event.offsetX, y: event.offsetY });
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, at(event));
    if (fingers.size === 1) moved = 0;
    spread = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const now = at(event), share = 1 / fingers.size;
    fingers.set(event.pointerId, now);
    moved += Math.hypot(now.x - before.x, now.y - before.y);
    view.x -= share * (now.x - before.x) / view.scale;
    view.y += share * (now.y - before.y) / view.scale;
    if (fingers.size === 2) {
      const [one, two] = fingers.values(), apart = Math.hypot(one.x - two.x, one.y - two.y);
      if (spread) zoom(apart / spread, { x: (one.x + two.x) / 2, y: (one.y + two.y) / 2 });
      spread = apart;
    }
    draw();
  });
  const lift = (event) => {
    if (fingers.delete(event.pointerId) && event.type === "pointerup" && !fingers.size && moved < 6) pick(at(event));
    spread = 0;
  };
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  function pick(place) {
    const box = canvas.getBoundingClientRect();
    let best = -1, least = 24;
    points.forEach((_, i) => {
      const [x, y] = onScreen(day.xy[2 * i], day.xy[2 * i + 1], box), away = Math.hypot(x - place.x, y - place.y);
      if (away < least) [best, least] = [i, away];
    });
    if (best >= 0) choose(best);
  }
  canvas.addEventListener("wheel", (event) => {
    if (document.activeElement !== canvas && !event.ctrlKey) return; // the page scrolls on
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), at(event));
  }, { passive: false });
  const keys = {
    ArrowRight: () => step(1), ArrowDown: () => step(1), ArrowLeft: () => step(-1), ArrowUp: () => step(-1),
    "+": () => zoom(1.4), "=": () => zoom(1.4), "-": () => zoom(1 / 1.4), 0: showAll,
  };
  canvas.addEventListener("keydown", (event) => {
    if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    keys[event.key]();
  });
  const pressed = { in: () => zoom(1.4), out: () => zoom(1 / 1.4), all: showAll, next: () => step(1), previous: () => step(-1),
    wrong: () => step(1, (i) => kinds[points[i]].wrong) };
  for (const [name, act] of Object.entries(pressed)) get(name).addEventListener("click", act);
  choices.study.addEventListener("change", chooseStudy);
  choices.method.addEventListener("change", chooseDay);
  choices.sequence.addEventListener("change", () => { chosen = -1; chooseDay(); });
  choices.by.addEventListener("change", colour);
  new ResizeObserver(() => view && draw()).observe(canvas);
  chooseStudy();
})();
