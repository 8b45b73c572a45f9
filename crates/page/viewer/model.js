// The model as the program packed it: crates/page/src/model.rs.

import { COMPRESSED } from './mode.js'

/**
 * - `signal`: ends it
 * - `known`: the model that was shown before, whose blocks are not fetched again
 */
export async function load(signal, known) {
  for (;;) {
    const about = await (await fetched('model.json', signal)).json()
    const blocks = await Promise.all(about.blocks.map((name) => known?.blockOf(name) ?? block(name, signal)))
    // While a bake goes on, a block may be out of date before it is fetched.
    if (!blocks.includes(undefined)) return new Model(about, blocks)
  }
}

async function fetched(name, signal) {
  const response = await fetch(name, { signal })
  if (!response.ok) throw new Error(`${name}: ${response.status}`)
  return response
}

/** A block of numbers; none if a newer one has taken its place. Those of an export are compressed. */
async function block(name, signal) {
  const response = await fetched(name, signal)
  if (response.status === 204) return undefined
  return (COMPRESSED ? new Response(response.body.pipeThrough(new DecompressionStream('gzip'))) : response).arrayBuffer()
}

export class Model {
  constructor(about, blocks) {
    this.about = about
    this.blocks = blocks
    this.positions = new Float32Array(this.vertexData('positions').buffer)
    this.indices = this.numbers('indices', Uint32Array).slice()
    const moved = this.numbers('moved', Uint32Array)
    for (let k = 0; k < moved.length; k += 2) this.indices[moved[k]] = moved[k + 1]
    this.codes = this.numbers('codes0', Uint16Array)
    this.charts = this.has('charts') ? this.numbers('charts', this.chartBytes === 2 ? Uint16Array : Uint32Array) : undefined
  }

  blockOf(name) {
    return this.blocks[this.about.blocks.indexOf(name)]
  }

  has(name) {
    return name in this.about.sections
  }

  numbers(name, Type) {
    const { block, offset, bytes } = this.about.sections[name]
    return new Type(this.blocks[block], offset, bytes / Type.BYTES_PER_ELEMENT)
  }

  /** What the geometry has of each vertex, copies of vertices among them, in words of 32 bits. */
  vertexData(name) {
    const first = this.numbers(name, Uint32Array)
    const copies = this.numbers('copies', Uint32Array)
    const width = first.length / (this.about.vertices - copies.length)
    const all = new Uint32Array(width * this.about.vertices)
    all.set(first)
    for (let copy = 0, o = first.length; copy < copies.length; copy++) {
      for (let k = 0; k < width; k++) all[o++] = first[width * copies[copy] + k]
    }
    return all
  }

  /** Bytes of the number of a vertex's chart. */
  get chartBytes() {
    return this.about.sections.charts.bytes / this.about.vertices
  }

  /** The name of a triangle's part. */
  partOf(triangle) {
    let end = 0
    const [part] = this.about.partRuns.find(([, count]) => triangle < (end += count))
    return this.about.parts[part]
  }

  /** Whether any layer shows the atlas. */
  get hasAtlas() {
    return this.about.layers[0].pages > 0
  }

  /** The layers irradianceSh0 to 3 or 8, in their order; none unless they can be looked at together. */
  get harmonics() {
    const { layers } = this.about
    const named = (k) => layers.findIndex(({ signal, form }) => signal === `irradianceSh${k}` && form === 'rgb')
    const found = [...Array(9).keys()].map(named)
    const count = found.includes(-1) ? 4 : 9
    return found.slice(0, count).includes(-1) ? [] : found.slice(0, count)
  }

  isTexture(vertex) {
    return this.codes[2 * vertex + 1] < 0x8000
  }

  corners(triangle) {
    return this.indices.subarray(3 * triangle, 3 * triangle + 3)
  }

  /** `texture`, `mixed` or `color`. */
  kind(triangle) {
    const count = this.corners(triangle).filter((v) => this.isTexture(v)).length
    return ['color', 'mixed', 'mixed', 'texture'][count]
  }

  position(vertex) {
    return this.positions.subarray(3 * vertex, 3 * vertex + 3)
  }

  /** In texels of the stack of pages. */
  place(vertex) {
    return [this.codes[2 * vertex] / 8, this.codes[2 * vertex + 1] / 8]
  }

  /** Triangles of three texture-vertices. */
  get textureIndices() {
    this.found ??= this.indices.filter((_, i) => {
      const first = i - (i % 3)
      return [0, 1, 2].every((k) => this.isTexture(this.indices[first + k]))
    })
    return this.found
  }

  /** Edges of all triangles, two vertices each. */
  lines(indices) {
    const lines = new Uint32Array(2 * indices.length)
    for (let i = 0, o = 0; i < indices.length; i += 3) {
      for (let k = 0; k < 3; k++) {
        lines[o++] = indices[i + k]
        lines[o++] = indices[i + ((k + 1) % 3)]
      }
    }
    return lines
  }

  /** The triangles whose last corner is a vertex. */
  endingAt(vertex) {
    if (!this.starts) {
      const count = this.indices.length / 3
      this.starts = new Uint32Array(this.about.vertices + 1)
      for (let t = 0; t < count; t++) this.starts[this.indices[3 * t + 2] + 1]++
      for (let v = 0; v < this.about.vertices; v++) this.starts[v + 1] += this.starts[v]
      const next = this.starts.slice()
      this.ending = new Uint32Array(count)
      for (let t = 0; t < count; t++) this.ending[next[this.indices[3 * t + 2]]++] = t
    }
    return this.ending.subarray(this.starts[vertex], this.starts[vertex + 1])
  }

  /**
   * Of the triangles that end at a vertex, the one that a point lies in, with the point's weights.
   * - `at`: the point, in the space of `where`
   * - `where`: corners in space or in the atlas
   */
  triangleAt(vertex, at, where) {
    let best
    for (const triangle of this.endingAt(vertex)) {
      const corners = [...this.corners(triangle)].map(where)
      const weights = barycentric(at, corners)
      const least = Math.min(...weights)
      const found = { triangle, weights, least, away: away(at, corners, weights) }
      if (!best || isNearer(found, best)) best = found
    }
    return best
  }
}

/** How far a point is from the plane of three corners; 0 where all lie in one. */
function away(at, corners, weights) {
  if (at.length === 2) return 0
  return Math.hypot(...at.map((x, k) => x - corners.reduce((sum, corner, c) => sum + weights[c] * corner[k], 0)))
}

/** Whether a point is rather in one triangle than in another one: around a vertex there may be some that fold back. */
function isNearer(a, b) {
  const inside = ({ least }) => least > -0.01
  return inside(a) && inside(b) && a.away !== b.away ? a.away < b.away : a.least > b.least
}

/** Weights of three corners, in two or three dimensions; far outside for triangles without area. */
function barycentric(p, [a, b, c]) {
  const minus = (x, y) => Array.from(x, (v, k) => v - y[k])
  const dot = (x, y) => x.reduce((sum, v, k) => sum + v * y[k], 0)
  const [u, v, w] = [minus(b, a), minus(c, a), minus(p, a)]
  const [uu, uv, vv, wu, wv] = [dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v)]
  const area = uu * vv - uv * uv
  if (!(area > 0)) return [-1e9, -1e9, -1e9]
  const [second, third] = [(vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area]
  return [1 - second - third, second, third]
}
