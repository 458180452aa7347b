// The map: where each query of a test day was taken, what a model answered, and what was seen at both ends.
(() => {
  const get = (name) => document.getElementById(`map-${name}`);
  const canvas = get("canvas"), pen = canvas.getContext("2d"), plane = d3.select(canvas);
  const choices = Object.fromEntries(["model", "sequence", "by"].map((name) => [name, get(name)])), mapped = document.getElementById("mapped");

  const KINDS = ["right", "wrong", "unseen", "none"]; // of an answer, as in web/map.py; ACCEPTED is added
  const ACCEPTED = 4, REACH_M = 42;
  const TYPES = { i4: Int32Array, u4: Uint32Array, i2: Int16Array, u2: Uint16Array, u1: Uint8Array, i1: Int8Array };
  const bytes = (base64) => Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  const revive = (_, value) => {
    if (!value || value.base64 === undefined) return value;
    const array = new TYPES[value.dtype](bytes(value.base64).buffer);
    return value.step ? Float32Array.from(array, (steps) => steps === value.missing ? NaN : steps * value.step) : array;
  };
  const read = async (id) => { // the data of a study, packed in the page
    const stream = new Blob([bytes(document.getElementById(id).textContent)]).stream().pipeThrough(new DecompressionStream("deflate"));
    return JSON.parse(await new Response(stream).text(), revive);
  };
  const make = (name, text = "", attributes = {}) => Object.assign(document.createElement(name), { textContent: text }, attributes);
  const tone = (name) => getComputedStyle(canvas).getPropertyValue(name);
  const studies = new Map(), images = new Map();
  let study, tested, day, answers, kinds, accepted, verb, ground, points = [], chosen = -1, size = [0, 0], view = d3.zoomIdentity;

  const image = (sheet) => { // the picture of all views of a sequence, or of what stood at training
    const load = (done) => make("img", "", { onload: (event) => done(event.target), src: `data:image/png;base64,${sheet.png}` });
    if (!images.has(sheet)) images.set(sheet, new Promise(load));
    return images.get(sheet);
  };

  async function chooseStudy(article) { // opens on an accepted answer of the last day
    const name = article.dataset.chart;
    if (!name) return;
    if (!studies.has(name)) studies.set(name, read(name));
    const chart = await studies.get(name);
    if (article.hidden) return; // another study was chosen meanwhile
    article.querySelector(".slot").append(mapped);
    mapped.hidden = false;
    study = chart;
    ground = null;
    const { footprint } = study;
    if (footprint) image(footprint).then((loaded) => { if (study.footprint === footprint) { ground = loaded; choose(chosen); } });
    choices.model.replaceChildren(...Object.keys(study.answers).map((model) => make("option", model, { value: model })));
    choices.model.value = study.best;
    chooseModel(study.sequences.length);
    showAll();
    openAccepted();
  }
  function chooseModel(at = choices.sequence.value) { // and a day that it was tested on
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
    openAccepted();
    mapped.scrollIntoView({ block: "nearest" });
  }
  function colour() {
    const by = choices.by.value, near = answers.posed && by === "accepted" ? `within ${answers.right_within[0]} m and ${answers.right_within[1]}°` : by === "cells" ? "in the query's grid cell" : `within ${study.correct_m} m`;
    const says = { right: near, wrong: by === "accepted" ? `not ${near}` : "seen, but placed elsewhere", unseen: "training was never there", none: by === "accepted" ? "no answer to judge" : "between seen and unseen" };
    kinds = KINDS.map((name) => ({ name: name === "none" ? "not judged" : name, colour: tone(`--${name}`), says: says[name], wrong: name === "wrong" }));
    const { code } = answers[by];
    points = Array.from(code, (value) => value % ACCEPTED);
    accepted = Array.from(code, (value) => value >= ACCEPTED);
    verb = by === "accepted" ? ["accepted", "refused"] : ["accepted", "rejected"];
    const entry = (tint, shape, text, title) => {
      const item = make("li", "", { title });
      item.append(make("i", "", { className: shape, style: `background: ${tint}` }), text);
      return item;
    };
    const counts = kinds.flatMap((kind, i) => [true, false].map((taken) => [kind, taken, points.filter((one, at) => one === i && accepted[at] === taken).length]));
    get("legend").replaceChildren(...counts.filter(([kind, taken, count]) => count || kind.wrong && taken)
      .map(([kind, taken, count]) => entry(kind.colour, taken ? "" : "faint", `${kind === kinds[3] ? kind.name : `${kind.name}, ${verb[taken ? 0 : 1]}`} ${count}`, kind.says)),
      entry(tone("--path"), "line", "training path", "where training drove"));
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
    if (ground) drawGround(pen, (x, y) => view.apply([x, -y]), view.k);
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
        pen.globalAlpha = taken || kind === kinds[3] ? 1 : 0.5;
        points.forEach((one, i) => kinds[one] === kind && accepted[i] === taken && disc(onScreen(day.xy, i), taken ? size : 0.5 * size, "fill"));
      }
      pen.globalAlpha = 1;
    }
    if (chosen >= 0) drawChosen(size);
    drawScale(height);
  }
  const tinted = (picture, colour) => { // the cells of a picture in one colour
    const sheet = make("canvas", "", { width: picture.width, height: picture.height }), brush = sheet.getContext("2d");
    brush.drawImage(picture, 0, 0);
    brush.globalCompositeOperation = "source-in";
    brush.fillStyle = colour;
    brush.fillRect(0, 0, sheet.width, sheet.height);
    return sheet;
  };
  function drawGround(brush, place, scale) { // what stood at training, where `place` puts metres on a canvas
    const { corner, cell_m: side } = study.footprint, colour = tone("--ground");
    if (ground.tint !== colour) Object.assign(ground, { tint: colour, sheet: tinted(ground, colour) });
    const [left, top] = place(corner[0], corner[1] + side * ground.height);
    brush.imageSmoothingEnabled = scale * side < 2;
    brush.drawImage(ground.sheet, left, top, ground.width * side * scale, ground.height * side * scale);
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
    if (hasRow(answers, chosen)) {
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
    pen.fillText(study.simulated ? `${length} m, simulated` : `${length} m`, 14, height - 20);
  }

  const hasRow = ({ row }, i) => 2 * row[i] < study.path.length;
  const metres = (value) => `${value.toFixed(value < 9.95 ? 1 : 0)} m`;
  const degrees = (value) => `${Math.round(value)}°`.replace("-", "−");
  const around = (value) => 180 - ((((180 - value) % 360) + 360) % 360);
  const error_m = (i) => Math.hypot(answers.xy[2 * i] - day.xy[2 * i], answers.xy[2 * i + 1] - day.xy[2 * i + 1]);
  function facts(i) {
    const kind = kinds[points[i]], by = choices.by.value === "accepted" ? "distance" : choices.by.value, rank = answers[by].rank[i], seen = answers[by].code[i] % ACCEPTED < 2;
    const { threshold } = answers, novelty = answers.novelty[i];
    const limit = threshold < -1e38 ? "the model refuses everything" : threshold > 1e38 ? "the model accepts everything" : `threshold ${threshold.toPrecision(3)}`;
    const trueHeading = degrees(day.heading[i]), given = answers.heading ? answers.heading[i] : NaN;
    return [
      ["Verdict", kind === kinds[3] ? kind.says : `${verb[accepted[i] ? 0 : 1]}, and ${kind.name}: ${kind.says}`],
      ["Error", !hasRow(answers, i) ? "the answer has no position" : `${metres(error_m(i))} from query to answer`],
      ["Novelty", `${novelty.toPrecision(3)} (${answers.kind}); ${limit}`],
      ["Heading", isFinite(given) ? `${degrees(given)}, true ${trueHeading}, off by ${degrees(Math.abs(around(given - day.heading[i])))}` : `not given; true ${trueHeading}`],
      ["True place", !seen ? `unseen, by ${by}` : rank < 0 ? `not ranked, by ${by}` : `rank ${rank + 1}, by ${by}`],
      ["Training pose", `${metres(day.nearest_m[i])} away at the nearest`],
    ];
  }
  function openAccepted() { // half-way along the drive
    chosen = Math.floor(points.length / 2);
    if (!acts.accepted()) choose(chosen);
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
    const keeps = i < 0 || isKept(i) ? "" : `This page holds the scans of ${day.kept.length} of this day's ${points.length} queries; of this query it holds the place only.`;
    get("scans").replaceChildren(...(i < 0 ? [] : [...scans(i), make("p", keeps, { className: "quiet" })]));
    get("views").replaceChildren(...(i < 0 ? [] : views(i)));
    get("network").hidden = !day.views;
    draw();
  }
  function scans(i) { // the scan on the map: where the answer says, and if that is wrong where it was taken
    if (!ground) return [];
    const at = day.scans ? day.kept.indexOf(i) : -1, placed = hasRow(answers, i), kind = kinds[points[i]];
    const heading = answers.heading ? answers.heading[i] : NaN, off = placed ? metres(error_m(i)) : "";
    const taken = { xy: day.xy, heading: day.heading[i], colour: tone("--taken"), caption: placed ? "The same scan where it was taken" : "Where the scan was taken: no answer" };
    const answer = { xy: answers.xy, heading: isFinite(heading) ? heading : day.heading[i], colour: kind.wrong ? tone("--wrong") : tone("--right"),
      caption: `Placed where the answer says, ${off} off${isFinite(heading) ? "" : " (its true heading)"}: ${verb[accepted[i] ? 0 : 1]}` };
    const shown = !placed ? [taken] : kind.wrong || error_m(i) > study.correct_m ? [answer, taken] : [answer];
    const figures = shown.map(({ xy, heading, colour, caption }) => {
      const figure = make("figure", "", { className: "scan" }), painted = make("canvas", "", { role: "img", ariaLabel: caption });
      figure.append(painted, make("figcaption", caption));
      requestAnimationFrame(() => drawScan(painted, [xy[2 * i], xy[2 * i + 1]], heading, at, colour));
      return figure;
    });
    return [...figures, make("p", mapped.dataset.scan, { className: "quiet" })];
  }
  function drawScan(painted, [x, y], heading, at, colour) { // north up, the robot in the middle
    const { clientWidth: width, clientHeight: height } = painted, ratio = window.devicePixelRatio || 1, scale = height / 2 / REACH_M;
    if (!width) return;
    [painted.width, painted.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const brush = painted.getContext("2d"), angle = heading * Math.PI / 180, [ahead, aside] = [Math.cos(angle), Math.sin(angle)];
    const place = (east, north) => [width / 2 + (east - x) * scale, height / 2 - (north - y) * scale];
    brush.setTransform(ratio, 0, 0, ratio, 0, 0);
    drawGround(brush, place, scale);
    brush.fillStyle = brush.strokeStyle = colour;
    if (at >= 0) {
      const { first, cells, cell_m: side } = day.scans;
      for (let n = first[at]; n < first[at + 1]; n++) {
        const forward = cells[2 * n] * side, left = cells[2 * n + 1] * side;
        const [across, down] = place(x + ahead * forward - aside * left, y + aside * forward + ahead * left);
        brush.fillRect(across - 1.2, down - 1.2, 2.4, 2.4);
      }
    }
    brush.lineWidth = 2.5;
    brush.beginPath(); // an arrow of 8 m
    brush.moveTo(...place(x - 3 * ahead, y - 3 * aside));
    brush.lineTo(...place(x + 5 * ahead, y + 5 * aside));
    brush.lineTo(...place(x + 2 * ahead - 2 * aside, y + 2 * aside + 2 * ahead));
    brush.moveTo(...place(x + 5 * ahead, y + 5 * aside));
    brush.lineTo(...place(x + 2 * ahead + 2 * aside, y + 2 * aside - 2 * ahead));
    brush.stroke();
    brush.fillStyle = tone("--quiet");
    brush.fillRect(10, height - 12, 20 * scale, 2);
    brush.font = "12px sans-serif";
    brush.fillText(study.simulated ? "20 m, simulated" : "20 m", 10, height - 17);
  }
  function views(i) {
    if (!day.views || !study.train) return [];
    const rolled = (shift) => shift ? `, rolled by ${degrees(around(shift * 360 / day.views.sectors))}` : "";
    const shown = [[day.views, day.kept.indexOf(i), 0, "The query"]].filter(([, row]) => row >= 0);
    const training = ({ row, shift }, what) => shown.push([study.train, row[i], shift[i], `${what}: training's view${rolled(shift[i])}`]);
    if (hasRow(answers, i)) training(answers, "The answer");
    if (day.row[i] !== answers.row[i] && day.nearest_m[i] <= study.correct_m) training(day, "The true place");
    const figures = shown.map(([sheet, row, shift, caption]) => {
      const figure = make("figure", "", { className: "view" });
      const painted = make("canvas", "", { width: sheet.sectors, height: sheet.rings, role: "img", ariaLabel: caption });
      figure.append(painted, make("figcaption", caption));
      image(sheet).then((loaded) => paint(painted.getContext("2d"), loaded, sheet, row, shift));
      return figure;
    });
    return [...figures, make("p", mapped.dataset.views, { className: "quiet" })];
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
      choose(i);
      return true;
    }
    return false;
  }
  canvas.addEventListener("click", (event) => { // the nearest query within 24 pixels
    const away = points.map((_, i) => onScreen(day.xy, i)).map(([x, y]) => Math.hypot(x - event.offsetX, y - event.offsetY));
    const best = away.reduce((least, one, i) => one < (least < 0 ? 24 : away[least]) ? i : least, -1);
    if (best >= 0) choose(best);
  });
  const isKept = (i) => day.kept.includes(i);
  const acts = { in: () => plane.call(zoom.scaleBy, 1.4), out: () => plane.call(zoom.scaleBy, 1 / 1.4), all: showAll,
    next: () => step(1), previous: () => step(-1), wrong: () => step(1, (i) => kinds[points[i]].wrong && isKept(i)) || step(1, (i) => kinds[points[i]].wrong), accepted: () => step(1, (i) => accepted[i] && (points[i] === 0) && isKept(i)) };
  const keys = { ArrowRight: "next", ArrowDown: "next", ArrowLeft: "previous", ArrowUp: "previous", "+": "in", "=": "in", "-": "out", 0: "all", f: "wrong", F: "wrong", b: "accepted", B: "accepted" };
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
    if (study) choose(chosen);
    if (before[0] && size[0]) plane.call(zoom.translateBy, (size[0] - before[0]) / 2 / view.k, (size[1] - before[1]) / 2 / view.k);
  }).observe(canvas);
})();
