// Cars on their road, frame by frame.
// Given: cars (each with law and passive, data sources, foremost, and views, each with its wheels),
// looked (the one of them whose signals are shown), cursor (data source), play (toggle), at
// (slider), what ("play", "draw"), and sizes: larger, spacing, before, body, radius, narrow.
// What is drawn is changed in place: nothing of it travels to the server.

function put(source, columns) {
  Object.assign(source.data, columns)
  source.change.emit()
}

function empty(...sources) {
  for (const own of sources) {
    put(own, Object.fromEntries(Object.keys(own.data).map((key) => [key, []])))
  }
}

// Through values at some places, straight in between and beyond.
function straight(at, values) {
  return (x) => {
    if (at.length == 1) return values[0]
    let i = 1
    while (i < at.length - 1 && x > at[i]) i++
    const share = (x - at[i - 1]) / (at[i] - at[i - 1] || 1)
    return values[i - 1] + share * (values[i] - values[i - 1])
  }
}

const signed = (value) => `${Math.round(value) || 0}`.replace("-", "\u2212")
const wheels = (view, own, key, k) => Array.from(view.wheels, (i) => own[`${key} ${i}`][k])

// The road as the wheels feel it: without the twist that no plane under them fits.
function ground(view, car, k) {
  const own = car.passive.data, [low, high] = view.span, twist = wheels(view, own, "twist", k)
  if (!view.along) {
    const felt = straight(view.at, wheels(view, own, "road", k).map((h, i) => h - twist[i]))
    return {x: [low, high], y: [felt(low), felt(high)]}
  }
  const all = view.road.data.height, last = all.length - 1, off = straight(view.at, twist)
  const first = Math.round((own.place[k] - car.foremost + low + before) / spacing)
  const count = Math.round((high - low) / spacing)
  const x = Array.from({length: count + 1}, (_, i) => low + i * spacing)
  return {x, y: x.map((at, i) => all[Math.max(0, Math.min(first + i, last))] - off(at))}
}

function outline(view, ends, unsprung) {
  const left = view.at[0] - 0.7, right = view.at[view.at.length - 1] + 0.7
  const x = [left, right, right, left, left]
  const y = [ends[0] - 0.18, ends[1] - 0.18, ends[1] + 0.18, ends[0] + 0.18, ends[0] - 0.18]
  const wide = view.along ? radius : narrow
  unsprung.forEach((height, i) => {
    x.push(NaN)
    y.push(NaN)
    for (let k = 0; k <= 24; k++) {
      const across = radius * Math.cos(k * Math.PI / 12)
      x.push(view.at[i] + Math.max(-wide, Math.min(across, wide)))
      y.push(radius + height + radius * Math.sin(k * Math.PI / 12))
    }
  })
  return {x, y}
}

// Springs, or bars, of all wheels as one line.
function joined(view, points) {
  const x = [], y = []
  view.at.forEach((at, i) => {
    for (const [aside, height] of points(i)) {
      x.push(at + aside)
      y.push(height)
    }
    x.push(NaN)
    y.push(NaN)
  })
  return {x, y}
}

function spring(from, to) {
  const zigzag = [[0, from]]
  for (let k = 1; k < 10; k++) zigzag.push([k % 2 ? 0.12 : -0.12, from + (to - from) * k / 10])
  return [...zigzag, [0, to]]
}

function draw(k) {
  for (const car of cars) show(car, k)
  const now = performance.now()
  if (play.active && now - (play.pointed || 0) < 100) return // signals take long to be drawn
  play.pointed = now
  put(cursor, {x: [...looked.passive.data.time.slice(k, k + 1)]})
}

function show(car, k) {
  const sources = (view) => [
    view.ground, view.passive, view.law, view.spring, view.force, view.lift, view.hit, view.words,
  ]
  if (!(k < car.passive.data.time.length)) {
    for (const view of car.views) empty(...sources(view))
    return
  }
  const grounds = car.views.map((view) => ground(view, car, k))
  const heights = grounds.flatMap((own) => own.y)
  const level = heights.reduce((sum, own) => sum + own, 0) / heights.length
  const up = (own) => larger * (own - level)
  car.views.forEach((view, j) => {
    const ends = (own) => [0, 1].map((i) => body + up(own[`end ${j} ${i}`][k]))
    const under = (own) => wheels(view, own, "unsprung", k).map(up)
    put(view.ground, {x: grounds[j].x, y: grounds[j].y.map(up)})
    put(view.passive, outline(view, ends(car.passive.data), under(car.passive.data)))
    const own = car.law.data, time = `${car.passive.data.time[k].toFixed(2)} s`
    const begin = view.span[0] + 0.05
    if (!own.time.length) {
      empty(view.law, view.spring, view.force, view.lift, view.hit)
      put(view.words, {x: [begin], y: [2.17], text: [`${time}   no law`], align: ["left"]})
      return
    }
    put(view.law, outline(view, ends(own), under(own)))
    const bottoms = wheels(view, own, "sprung", k).map((height) => body - 0.18 + up(height))
    const tops = under(own).map((height) => radius + height)
    const force = wheels(view, own, "force", k)
    put(view.spring, joined(view, (i) => spring(tops[i], bottoms[i])))
    const bars = (i) => [[0.45, bottoms[i]], [0.45, bottoms[i] + force[i] / 3000]]
    put(view.force, joined(view, bars))
    const lifted = wheels(view, own, "lifted", k), stopped = wheels(view, own, "stopped", k)
    const lit = view.at.filter((_, i) => lifted[i])
    put(view.lift, {x: lit, y: lit.map(() => -0.38)})
    const hit = view.at.map((at, i) => [at, tops[i]]).filter((_, i) => stopped[i])
    put(view.hit, {x: hit.map(([x]) => x), y: hit.map(([, y]) => y)})
    const said = [time]
    if (lifted.some(Boolean)) said.push("the tyre leaves the road")
    if (stopped.some(Boolean)) said.push("a bump stop is hit")
    put(view.words, {
      x: [begin, ...view.at],
      y: [2.17, ...view.at.map(() => 1.95)],
      text: [said.join("   "), ...force.map((own, i) => `${view.names[i]} ${signed(own)} N`)],
      align: ["left", ...view.at.map(() => "center")],
    })
  })
}

function frame(seconds) {
  const last = Math.max(looked.passive.data.time.length - 1, 0)
  return Math.round(Math.min(seconds / at.end, 1) * last)
}
if (what == "play") {
  play.label = play.active ? "Pause" : "Play"
  const begun = performance.now() - 1000 * at.value
  let seconds = at.value
  const next = () => {
    if (!play.active) {  // the slider is where the picture is
      at.value = Math.round(seconds / at.step) * at.step
      return
    }
    seconds = ((performance.now() - begun) / 1000) % at.end
    draw(frame(seconds))
    play.frames = (play.frames || 0) + 1
    requestAnimationFrame(next)
  }
  next()
} else if (!play.active) {
  draw(frame(at.value))
}
