// What a picture of stored light must be: the triangles of a scene under an orthographic camera, decoded on the CPU.

/** Views from the six sides would see mostly the same; these see all sides of things, none of them straight on. */
export const VIEWS = [[0.3, 0.8, 0.5], [-0.7, 0.4, -0.6], [0.6, -0.5, 0.62]]

const SIZE = 256

/** Rasterizers put corners on a grid; that of SwiftShader has 16 steps a pixel. A picture may be off by one of them. */
const SNAP = 1 / 16
const STEPS = [-1, -0.75, -0.5, -0.25, 0, 0.25, 0.5, 0.75, 1].map((step) => step * SNAP)
const AROUND = STEPS.flatMap((dx) => STEPS.map((dy) => [dx, dy]))
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
const unit = (v) => v.map((x) => x / Math.hypot(...v))

/** A camera that sees all triangles; `toward` points from the scene to it. */
export function cameraFor(triangles, toward) {
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]]
  for (const { corners } of triangles) {
    for (const corner of corners) {
      corner.forEach((x, k) => {
        low[k] = Math.min(low[k], x)
        high[k] = Math.max(high[k], x)
      })
    }
  }
  const center = low.map((x, k) => (x + high[k]) / 2)
  const radius = Math.hypot(...low.map((x, k) => high[k] - x)) / 2
  const front = unit(toward)
  const right = unit(cross(Math.abs(front[1]) > 0.9 ? [1, 0, 0] : [0, 1, 0], front))
  // A little off, so that no edge of an axis-aligned box runs through the middle of pixels.
  return { right, up: cross(front, right), toward: front, center, half: radius * 0.803, depth: radius * 1.1 }
}

/**
 * The pixels where a picture can be told for certain: inside of a triangle by `margin` pixels, with nothing else as near.
 *
 * - returns: `{ x, y, triangle, place }` each; y counts from the bottom, as WebGL's; `place(dx, dy)` is the barycentric
 *   of a place so many pixels from the middle
 */
export function visible(triangles, { right, up, toward, center, half, depth }, margin = 1.25 * SNAP) {
  const pixels = new Int32Array(SIZE * SIZE).fill(-1)
  const nearest = new Float64Array(SIZE * SIZE).fill(-Infinity)
  // The nearest may lie between these two, by how steep it is; of all others, the nearest end.
  const closest = new Float64Array(SIZE * SIZE).fill(-Infinity)
  const farthest = new Float64Array(SIZE * SIZE).fill(-Infinity)
  const second = new Float64Array(SIZE * SIZE).fill(-Infinity)
  const unclear = new Uint8Array(SIZE * SIZE)
  const places = new Map() // of pixels
  const project = (point) => {
    const from = point.map((x, k) => x - center[k])
    return [(dot(from, right) / half + 1) * SIZE / 2, (dot(from, up) / half + 1) * SIZE / 2, dot(from, toward)]
  }
  triangles.forEach(({ corners }, number) => {
    const [a, b, c] = corners.map(project)
    const area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    const longest = Math.max(...[[a, b], [b, c], [c, a]].map(([p, q]) => Math.hypot(p[0] - q[0], p[1] - q[1])))
    const steep = (k) => Math.abs((b[k] - a[k]) * (c[2] - a[2]) - (c[k] - a[k]) * (b[2] - a[2]))
    const slope = ((steep(0) + steep(1)) * SNAP) / Math.abs(area)
    const range = (k) => [Math.min(a[k], b[k], c[k]), Math.max(a[k], b[k], c[k])]
    const [[x0, x1], [y0, y1]] = [range(0), range(1)]
    for (let y = Math.max(0, Math.floor(y0 - 0.6)); y < Math.min(SIZE, Math.ceil(y1 + 0.6)); y++) {
      for (let x = Math.max(0, Math.floor(x0 - 0.6)); x < Math.min(SIZE, Math.ceil(x1 + 0.6)); x++) {
        const [px, py, pixel] = [x + 0.5, y + 0.5, y * SIZE + x]
        // Seen from the side or smaller than the margin: whether it covers the pixel is a matter of rounding.
        if (Math.abs(area) < margin * longest) {
          unclear[pixel] = 1
          continue
        }
        const weight = (p, q) => ((q[0] - p[0]) * (py - p[1]) - (q[1] - p[1]) * (px - p[0])) / area
        const w = [weight(b, c), weight(c, a), weight(a, b)]
        const slack = (margin * longest) / Math.abs(area)
        const least = Math.min(...w)
        if (least < -slack) continue
        const z = a[2] * w[0] + b[2] * w[1] + c[2] * w[2]
        const far = z + slope
        if (least < slack) {
          // An edge: something may or may not be here, at this depth; of a sliver, at that of any corner.
          second[pixel] = Math.max(second[pixel], slack < 0.25 ? far : Math.max(a[2], b[2], c[2]))
          continue
        }
        if (z > nearest[pixel]) {
          second[pixel] = Math.max(second[pixel], farthest[pixel])
          nearest[pixel] = z
          farthest[pixel] = far
          closest[pixel] = z - slope
          pixels[pixel] = number
          const place = (dx, dy) => [[c, a], [a, b]].map(([p, q], k) =>
            w[k + 1] + ((q[0] - p[0]) * dy - (q[1] - p[1]) * dx) / area)
          places.set(pixel, place)
        } else second[pixel] = Math.max(second[pixel], far)
      }
    }
  })
  const clear = []
  pixels.forEach((number, pixel) => {
    if (number < 0 || unclear[pixel] || closest[pixel] - second[pixel] < 1e-4 * depth) return
    clear.push({ x: pixel % SIZE, y: Math.floor(pixel / SIZE), triangle: triangles[number], place: places.get(pixel) })
  })
  return clear
}

/** How far pixels are from the light of a layer: the largest difference, and how many of how many are over a bound. */
export function compare(clear, layer, pixels, bound) {
  let [largest, over, compared] = [0, 0, 0]
  for (const { x, y, triangle, place } of clear) {
    if (triangle.codes === null) continue
    compared++
    const shown = pixels.subarray((y * SIZE + x) * 4)
    const light = layer.light(triangle, place(0, 0))
    let error = Math.max(...light.map((value, c) => Math.abs(value - shown[c])))
    if (error > bound) {
      const around = AROUND.map(([dx, dy]) => layer.light(triangle, place(dx, dy)))
      error = Math.max(...light.map((_, c) => {
        const values = around.map((light) => light[c])
        return Math.max(Math.min(...values) - shown[c], shown[c] - Math.max(...values))
      }))
    }
    largest = Math.max(largest, error)
    if (!(error <= bound)) over++
  }
  return { largest, over, compared }
}
