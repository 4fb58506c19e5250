// The proved point of a trade-off that is nearest to the pointer is asked for.
// Given: points, dot, picked (data sources), plot.
const {x, y} = points.data
let found = -1, best = Infinity
for (let i = 0; i < x.length; i++) {
  const away = Math.abs(x[i] - cb_obj.x)
  if (away < best) { best = away; found = i }
}
if (found >= 0 && !(picked.data.number[0] == found && dot.data.x[0] == x[found])) {
  dot.data = {x: [x[found]], y: [y[found]]}
  picked.data = {number: [found]}
}
