// The map: where each query of a test day was taken, what a model answered, and what was seen at both ends.
(() => {
  const get = (name) => document.getElementById(`map-${name}`);
  const canvas = get("canvas"), pen = canvas.getContext("2d"), plane = d3.select(canvas);
  const choices = Object.fromEntries(["model", "sequence", "by"].map((name) => [name, get(name)])), mapped = document.getElementById("mapped");

  const NONE = 0xffffffff; // the training row of an answer without a position
  const QUIET = { name: "not judged", colour: "#c9c8c2", says: "between seen and unseen" };
  const TYPES = { f4: Float32Array, u4: Uint32Array, u2: Uint16Array, u1: Uint8Array, i2: Int16Array, i1: Int8Array };
  const revive = (_, value) => value && value.base64 !== undefined
    ? new TYPES[value.dtype](Uint8Array.from(atob(value.base64), (letter) => letter.charCodeAt(0)).buffer) : value;
  const make = (name, text = "", attributes = {}) => Object.assign(document.createElement(name), { textContent: text }, attributes);
  const tone = (name) => getComputedStyle(canvas).getPropertyValue(name);
  const studies = new Map(), images = new Map();
  let study, tested, day, answers, kinds, accepted, points = [], chosen = -1, size = [0, 0], view = d3.zoomIdentity;

  const image = (sheet) => { // the picture of all views of a sequence
    const load = (done) => make("img", "", { onload: (event) => done(event.target), src: `data:image/png;base64,${sheet.png}` });
    if (!images.has(sheet)) images.set(sheet, new Promise(load));
    return images.get(sheet);
  };

  function chooseStudy(article) { // it opens on what its best model got wrong on the last day
    const name = article.dataset.chart;
    if (!name) return;
    article.querySelector(".slot").append(mapped);
    mapped.hidden = false;
    if (!studies.has(name)) studies.set(name, JSON.parse(document.getElementById(name).textContent, revive));
    study = studies.get(name);
    choices.model.replaceChildren(...Object.keys(study.answers).map((model) => make("option", model, { value: model })));
    choices.model.value = study.best;
    chooseModel(study.sequences.length);
    showAll();
    acts.wrong();
  }
  function chooseModel(at = choices.sequence.value) { // and one of the days that it was tested on
    tested = study.sequences.filter(({ name }) => name in study.answers[choices.model.value]);
    choices.sequence.max = tested.length - 1;
    choices.sequence.value = Math.min(at, tested.length - 1);
    choices.sequence.closest("label").hidden = tested.length < 2;
    chooseDay();
  }
  function chooseDay() {
    const before = day;
    day = tested[choices.sequence.value];
    get("day").textContent = choices.sequence.ariaValueText = day.label;
    answers = study.answers[choices.model.value][day.name];
    if (day !== before) chosen = -1;
    colour();
  }
  function open({ model, day: name }) {
    choices.model.value = model;
    chooseModel(study.sequences.findIndex((one) => one.name === name));
    acts.wrong();
    mapped.scrollIntoView({ block: "nearest" });
  }
  function colour() {
    const says = [`within ${study.correct_m} m`, "seen, but placed elsewhere", "training was never there"];
    const { outcome, rank, seen } = answers[choices.by.value];
    if (choices.by.value === "cells") says[0] = "the very cell";
    kinds = [...study.kinds.map((one, i) => ({ ...one, says: says[i], wrong: i === 1 })), QUIET];
    points = Array.from(outcome, (code, i) => code === 4 ? 3 : !seen[i] ? 2 : rank[i] === 0 ? 0 : 1);
    accepted = Array.from(outcome, (code) => code === 0 || code === 2); // a hit or a false alarm
    const entry = (tint, shape, text, title) => {
      const item = make("li", "", { title });
      item.append(make("i", "", { className: shape, style: `background: ${tint}` }), text);
      return item;
    };
    const counted = kinds.map((kind, i) => [kind, points.filter((one) => one === i).length]).filter(([kind, count]) => count || kind !== QUIET);
    get("legend").replaceChildren(...counted.map(([kind, count]) => entry(kind.colour, "", `${kind.name} ${count}`, kind.says)),
      entry("#33333355", "", "faint: rejected", "at the model's own threshold"), entry(tone("--path"), "line", "training path", "where training drove"));
    choose(chosen);
  }

  // The plane is in metres, y downwards; `view` takes it to the pixels of the canvas, so that its scale is pixels per metre.
  const onScreen = (xy, i) => view.apply([xy[2 * i], -xy[2 * i + 1]]);
  const zoom = d3.zoom().clickDistance(6)
    .filter((event) => event.type === "wheel" ? document.activeElement === canvas || event.ctrlKey : !event.button && !event.ctrlKey)
    .on("zoom", (event) => { view = event.transform; draw(); });
  plane.call(zoom);
  function showAll() {
    const range = (axis) => [...study.path, ...day.xy].filter((_, i) => i % 2 === axis)
      .reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
    const [[left, right], [low, high]] = [range(0), range(1)], { clientWidth: width, clientHeight: height } = canvas;
    size = [width, height];
    const scale = Math.min((width - 56) / Math.max(right - left, 1), (height - 56) / Math.max(high - low, 1));
    zoom.scaleExtent([scale / 2, 200]);
    plane.call(zoom.transform, d3.zoomIdentity.translate(width / 2, height / 2).scale(scale).translate(-(left + right) / 2, (low + high) / 2));
  }
  function draw() {
    const { clientWidth: width, clientHeight: height } = canvas, ratio = window.devicePixelRatio || 1;
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.lineJoin = pen.lineCap = "round";
    colourPen(tone("--path"), 4);
    pen.beginPath();
    for (let i = 0, path = study.path; 2 * i < path.length; i++) {
      const jump = i && Math.hypot(path[2 * i] - path[2 * i - 2], path[2 * i + 1] - path[2 * i - 1]) > 30;
      pen[i && !jump ? "lineTo" : "moveTo"](...onScreen(path, i));
    }
    pen.stroke();
    const size = Math.min(Math.max(1.1 * view.k, 2.6), 7);
    const upwards = [...kinds].reverse().sort((a, b) => Boolean(a.wrong) - Boolean(b.wrong)); // what went wrong lies on top
    for (const kind of upwards) {
      pen.fillStyle = kind.colour;
      for (const taken of [false, true]) {
        pen.globalAlpha = taken || kind === kinds[3] ? 1 : 0.3;
        points.forEach((one, i) => kinds[one] === kind && accepted[i] === taken && disc(onScreen(day.xy, i), size, "fill"));
      }
      pen.globalAlpha = 1;
    }
    if (chosen >= 0) drawChosen(size);
    drawScale(height);
  }
  function colourPen(colour, width) {
    pen.strokeStyle = pen.fillStyle = colour;
    pen.lineWidth = width;
  }
  function disc(centre, radius, how) {
    pen.beginPath();
    pen.arc(...centre, radius, 0, 2 * Math.PI);
    pen[how]();
  }
  function line(how, ...corners) {
    pen.beginPath();
    corners.forEach((corner, i) => pen[i ? "lineTo" : "moveTo"](...corner));
    pen[how]();
  }
  function drawChosen(size) { // a ring around the query, a line to a diamond at the answer
    const from = onScreen(day.xy, chosen);
    colourPen(tone("--ink"), 1.6);
    if (answers.row[chosen] !== NONE) {
      const [x, y] = onScreen(answers.xy, chosen);
      const [dx, dy] = [x - from[0], y - from[1]], edge = Math.min(1, (size + 4) / (Math.hypot(dx, dy) || 1));
      line("stroke", [from[0] + edge * dx, from[1] + edge * dy], [x, y]);
      line("fill", [x, y - 6], [x + 6, y], [x, y + 6], [x - 6, y]);
    }
    disc(from, size + 4, "stroke");
  }
  function drawScale(height) { // the longest of 1, 2, 5, 10, … metres that fits into 130 pixels
    const wanted = 130 / view.k, power = 10 ** Math.floor(Math.log10(wanted));
    const length = Math.max(...[1, 2, 5].map((step) => step * power).filter((step) => step <= wanted));
    colourPen(tone("--quiet"), 2);
    line("stroke", [14, height - 14], [14 + length * view.k, height - 14]);
    pen.font = "12px sans-serif";
    pen.fillText(`${length} m`, 14, height - 20);
  }

  const metres = (value) => `${value.toFixed(value < 9.95 ? 1 : 0)} m`;
  const degrees = (value) => `${Math.round(value)}°`.replace("-", "−");
  const around = (value) => 180 - ((((180 - value) % 360) + 360) % 360);
  function facts(i) {
    const kind = kinds[points[i]], by = choices.by.value, rank = answers[by].rank[i];
    const error_m = Math.hypot(answers.xy[2 * i] - day.xy[2 * i], answers.xy[2 * i + 1] - day.xy[2 * i + 1]);
    const { threshold } = answers, novelty = answers.novelty[i];
    const limit = threshold < -1e38 ? "the model rejects everything" : threshold > 1e38 ? "the model accepts everything"
      : `${novelty >= threshold ? "rejected" : "accepted"}: threshold ${threshold.toPrecision(3)}`;
    const truth = degrees(day.heading[i]), given = answers.heading ? answers.heading[i] : NaN;
    return [
      ["Outcome", `${kind.name}: ${kind.says}`],
      ["Error", answers.row[i] === NONE ? "the answer has no position" : `${metres(error_m)} from query to answer`],
      ["Novelty", `${novelty.toPrecision(3)} (${answers.kind}); ${limit}`],
      ["Heading", isFinite(given) ? `${degrees(given)}, true ${truth}, off by ${degrees(Math.abs(around(given - day.heading[i])))}` : `not given; true ${truth}`],
      ["True place", !answers[by].seen[i] ? `unseen, by ${by}` : rank < 0 ? `not ranked, by ${by}` : `rank ${rank + 1}, by ${by}`],
      ["Training pose", `${metres(day.nearest_m[i])} away at the nearest`],
    ];
  }
  function choose(i) {
    chosen = i;
    const hint = make("p", "Choose a query on the map, or step along the drive."), list = make("dl");
    list.append(...(i < 0 ? [] : facts(i)).map(([name, value]) => {
      const entry = make("div");
      entry.append(make("dt", name), make("dd", value));
      return entry;
    }));
    get("query").replaceChildren(...(i < 0 ? [hint] : [make("h3", `Query ${i + 1} of ${points.length}`), list]));
    get("views").replaceChildren(...(i < 0 ? [] : views(i)));
    draw();
  }
  function views(i) {
    if (!day.views || !study.train) return [make("p", "No model of this study looks at Scan Contexts, so no view is shown.", { className: "quiet" })];
    const rolled = (shift) => shift ? `, rolled by ${degrees(around(shift * 360 / day.views.sectors))}` : "";
    const shown = [[day.views, i, 0, "The query"]];
    const training = ({ row, shift }, what) => shown.push([study.train, row[i], shift[i], `${what}: training's view${rolled(shift[i])}`]);
    if (answers.row[i] !== NONE) training(answers, "The answer");
    if (day.row[i] !== answers.row[i] && day.nearest_m[i] <= study.correct_m) training(day, "The truth");
    const figures = shown.map(([sheet, row, shift, caption]) => {
      const figure = make("figure", "", { className: "view" });
      const painted = make("canvas", "", { width: sheet.sectors, height: sheet.rings, role: "img", ariaLabel: caption });
      figure.append(painted, make("figcaption", caption));
      image(sheet).then((loaded) => paint(painted.getContext("2d"), loaded, sheet, row, shift));
      return figure;
    });
    return [...figures, make("p", mapped.dataset.note, { className: "quiet" })];
  }
  function paint(brush, loaded, { rings, sectors, columns }, row, shift) {
    const left = (row % columns) * sectors, top = Math.floor(row / columns) * rings, rest = sectors - shift;
    brush.imageSmoothingEnabled = false;
    brush.setTransform(1, 0, 0, -1, 0, rings); // the nearest ring at the bottom
    brush.drawImage(loaded, left, top, rest, rings, shift, 0, rest, rings);
    if (shift) brush.drawImage(loaded, left + rest, top, shift, rings, 0, 0, shift, rings);
  }
  function step(by, wanted = () => true) {
    const count = points.length;
    for (let n = 1, i = chosen < 0 && by < 0 ? 0 : chosen; n <= count; n++) {
      i = (i + by + count) % count;
      if (!wanted(i)) continue;
      const [x, y] = onScreen(day.xy, i), inside = (at, length) => at >= 20 && at <= length - 20; // keep the chosen query in sight
      if (!inside(x, canvas.clientWidth) || !inside(y, canvas.clientHeight)) plane.call(zoom.translateTo, day.xy[2 * i], -day.xy[2 * i + 1]);
      return choose(i);
    }
  }
  canvas.addEventListener("click", (event) => { // the nearest query within 24 pixels
    const away = points.map((_, i) => onScreen(day.xy, i)).map(([x, y]) => Math.hypot(x - event.offsetX, y - event.offsetY));
    const best = away.reduce((least, one, i) => one < (least < 0 ? 24 : away[least]) ? i : least, -1);
    if (best >= 0) choose(best);
  });
  const acts = { in: () => plane.call(zoom.scaleBy, 1.4), out: () => plane.call(zoom.scaleBy, 1 / 1.4), all: showAll,
    next: () => step(1), previous: () => step(-1), wrong: () => step(1, (i) => kinds[points[i]].wrong) };
  const keys = { ArrowRight: "next", ArrowDown: "next", ArrowLeft: "previous", ArrowUp: "previous", "+": "in", "=": "in", "-": "out", 0: "all" };
  canvas.addEventListener("keydown", (event) => {
    if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    acts[keys[event.key]]();
  });
  for (const [name, act] of Object.entries(acts)) get(name).addEventListener("click", act);
  choices.model.addEventListener("change", () => chooseModel());
  choices.sequence.addEventListener("input", chooseDay);
  choices.by.addEventListener("change", colour);
  addEventListener("study", ({ detail }) => chooseStudy(detail));
  addEventListener("open", ({ detail }) => open(detail));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => study && colour());
  new ResizeObserver(() => { // what was in the middle stays there
    const before = size;
    size = [canvas.clientWidth, canvas.clientHeight];
    if (before[0] && size[0]) plane.call(zoom.translateBy, (size[0] - before[0]) / 2 / view.k, (size[1] - before[1]) / 2 / view.k);
  }).observe(canvas);
})();
