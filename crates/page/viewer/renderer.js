// Draws a model with WebGL 2: two ways of showing it left and right of a divider, the atlas in a corner, and what lies
// under the pointer.

import { Camera } from './camera.js'
import { ATTRIBUTES, harmonics, programs } from './shaders.js'

const OVERLAYS = ['none', 'classes', 'charts', 'density', 'error']
const SOURCES = { hybrid: 0, vertices: 0, fallback: 1, none: 2 }
// That of the program's own pictures: linear 0.28, 0.32, 0.38.
const BACKGROUND = [0.5666, 0.6030, 0.6516, 1]

export class Renderer {
  constructor(canvas, model) {
    const gl = canvas.getContext('webgl2', { antialias: true, powerPreference: 'high-performance' })
    if (!gl) throw new Error('this browser has no WebGL 2')
    Object.assign(this, { gl, canvas, model, arrays: new Map(), buffers: new Map() })
    this.programs = programs(gl)
    this.layers = model.about.layers.map((layer, number) => this.images(layer, number))
    this.indices = this.indexBuffer(model.indices)
    this.picking = this.pickTarget()
  }

  buffer(name) {
    const { gl, model } = this
    if (!this.buffers.has(name)) {
      const buffer = gl.createBuffer()
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer)
      gl.bufferData(gl.ARRAY_BUFFER, model.numbers(name, Uint8Array), gl.STATIC_DRAW)
      this.buffers.set(name, buffer)
    }
    return this.buffers.get(name)
  }

  indexBuffer(indices) {
    const { gl } = this
    gl.bindVertexArray(null)
    const buffer = gl.createBuffer()
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer)
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW)
    return { buffer, count: indices.length }
  }

  /** Attributes with the codes of one section. */
  vertices(codes) {
    const { gl, model } = this
    if (!this.arrays.has(codes)) {
      const array = gl.createVertexArray()
      gl.bindVertexArray(array)
      const attribute = (name, section, size, type, normalized, stride) => {
        gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer(section))
        gl.enableVertexAttribArray(ATTRIBUTES[name])
        if (type === gl.UNSIGNED_INT) gl.vertexAttribIPointer(ATTRIBUTES[name], size, type, stride, 0)
        else gl.vertexAttribPointer(ATTRIBUTES[name], size, type, normalized, stride, 0)
      }
      attribute('position', 'positions', 3, gl.FLOAT, false, 12)
      attribute('normal', 'normals', 3, gl.BYTE, true, 4)
      attribute('base', 'baseColors', 3, gl.UNSIGNED_BYTE, true, 4)
      attribute('ids', 'ids', 2, gl.UNSIGNED_INT, false, 8)
      attribute('code', codes, 2, gl.UNSIGNED_SHORT, false, 4)
      if (model.has('fallback')) attribute('fallback', 'fallback', 3, gl.UNSIGNED_BYTE, true, 4)
      this.arrays.set(codes, array)
    }
    gl.bindVertexArray(this.arrays.get(codes))
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.indices.buffer)
  }

  /** The pages of a layer as an array of textures, and its table. */
  images(layer, number) {
    const { gl, model } = this
    const [width, height] = layer.pages ? model.about.pageSize : [1, 1]
    const one = layer.numbers === 1
    const pages = Math.max(1, layer.pages)
    const deep = layer.bits === 16
    const limit = gl.getParameter(gl.MAX_TEXTURE_SIZE)
    const most = gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS)
    if (Math.max(width, height) > limit || pages > most) {
      throw new Error(`the atlas has ${pages} pages of ${width} × ${height}, and this browser takes ${most} of ${limit} × ${limit}`)
    }
    const atlas = gl.createTexture()
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, atlas)
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1)
    const inside = deep ? (one ? gl.R16F : gl.RGB16F) : one ? gl.R8 : gl.RGB8
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, inside, width, height, pages)
    for (let page = 0; page < layer.pages; page++) {
      const texels = model.texels(layer, `page${number}_${page}`)
      const values = deep ? Float32Array.from(texels, (t) => t / 65535) : texels
      gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, page, width, height, 1, one ? gl.RED : gl.RGB, deep ? gl.FLOAT : gl.UNSIGNED_BYTE, values)
    }
    this.filter(gl.TEXTURE_2D_ARRAY, gl.LINEAR)
    const table = gl.createTexture()
    gl.bindTexture(gl.TEXTURE_2D, table)
    const colors = layer.form === 'table' ? model.texels(layer, `table${number}`) : new Uint8Array(layer.numbers)
    const columns = layer.form === 'table' ? 256 : 1
    const rows = colors.length / layer.numbers / columns
    // A table of one channel is read in all three.
    const rgb = one ? Uint8Array.from({ length: colors.length * 3 }, (_, i) => colors[Math.floor(i / 3)]) : colors
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, columns, rows, 0, gl.RGB, gl.UNSIGNED_BYTE, rgb)
    this.filter(gl.TEXTURE_2D, gl.NEAREST)
    return { atlas, table }
  }

  filter(target, filter) {
    const { gl } = this
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(target, name, filter)
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(target, name, gl.CLAMP_TO_EDGE)
  }

  pickTarget() {
    const { gl } = this
    const target = gl.createFramebuffer()
    gl.bindFramebuffer(gl.FRAMEBUFFER, target)
    const storage = (format, attachment) => {
      const buffer = gl.createRenderbuffer()
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer)
      gl.renderbufferStorage(gl.RENDERBUFFER, format, 1, 1)
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, attachment, gl.RENDERBUFFER, buffer)
    }
    storage(gl.RGBA32UI, gl.COLOR_ATTACHMENT0)
    storage(gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT)
    gl.bindFramebuffer(gl.FRAMEBUFFER, null)
    return target
  }

  /** The canvas in pixels follows its size on the page. */
  resize() {
    const ratio = Math.min(2, globalThis.devicePixelRatio || 1)
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight].map((n) => Math.max(1, Math.round(n * ratio)))
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height })
    this.ratio = ratio
  }

  /**
   * - `state`: camera, layer, left, right, divider (0 to 1), overlay, materials, wireframe, exposure, atlas (undefined or
   *   box, middle and zoom), picked (undefined or a triangle)
   */
  draw(state) {
    const { gl, canvas } = this
    this.resize()
    const [width, height] = [canvas.width, canvas.height]
    gl.bindFramebuffer(gl.FRAMEBUFFER, null)
    gl.disable(gl.SCISSOR_TEST)
    gl.viewport(0, 0, width, height)
    gl.clearColor(...BACKGROUND)
    gl.depthMask(true)
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT)
    const split = Math.round(width * state.divider)
    gl.enable(gl.SCISSOR_TEST)
    for (const [show, from, to] of [[state.left, 0, split], [state.right, split, width]]) {
      if (to <= from) continue
      gl.scissor(from, 0, to - from, height)
      this.scene(state, show)
    }
    if (state.atlas) this.atlas(state)
    gl.disable(gl.SCISSOR_TEST)
  }

  scene(state, show) {
    const { gl, canvas, model } = this
    const matrix = state.camera.clipFromWorld(canvas.width, canvas.height)
    gl.enable(gl.DEPTH_TEST)
    gl.depthFunc(gl.LEQUAL)
    const view = { clipFromWorld: matrix, inAtlas: 0, atlasView: [0, 0, 1, 1] }
    const together = state.harmonics && state.overlay === 'none' && (show === 'hybrid' || show === 'vertices')
    if (together) this.harmonics(state, show, matrix)
    else this.surface(state, show, view)
    this.triangles(this.indices)
    if (state.overlay === 'error' && model.has('errors')) this.errors(state, matrix)
    if (state.wireframe) {
      this.wires ??= this.indexBuffer(model.lines(model.indices))
      this.lines(view, [0, 0, 0, 0.3], 1e-5)
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.wires.buffer)
      gl.drawElements(gl.LINES, this.wires.count, gl.UNSIGNED_INT, 0)
      this.linesDone()
    }
    if (state.picked) {
      this.lines(view, [0.1, 0.9, 1, 0.35], 1e-4)
      gl.drawElements(gl.TRIANGLES, 3, gl.UNSIGNED_INT, 12 * state.picked.triangle)
      gl.disable(gl.DEPTH_TEST)
      this.lines(view, [0.1, 0.9, 1, 1], 0)
      gl.drawElements(gl.LINE_LOOP, 3, gl.UNSIGNED_INT, 12 * state.picked.triangle)
      this.linesDone()
    }
  }

  /** Binds what a surface is drawn with. */
  surface(state, show, view) {
    const { gl, model } = this
    const about = model.about.layers[state.layer]
    const alone = show === 'vertices'
    this.vertices(`${alone ? 'vertexCodes' : 'codes'}${state.layer}`)
    const { made, uniforms } = this.programs.surface
    gl.useProgram(made)
    this.view(uniforms, view)
    this.light(uniforms, about, state)
    const form = alone && about.form === 'table' ? (about.channels === 1 ? 'scalar' : 'rgb') : about.form
    gl.uniform1i(uniforms.form, ['scalar', 'rgb', 'table'].indexOf(form))
    gl.uniform1i(uniforms.source, SOURCES[show])
    gl.uniform1i(uniforms.overlay, OVERLAYS.indexOf(state.overlay))
    gl.uniform1i(uniforms.materials, state.materials ? 1 : 0)
    gl.uniform1f(uniforms.texelSize, model.about.texelSize)
    gl.uniform3fv(uniforms.eye, state.camera.eye())
  }

  /** As `surface`, of all layers of harmonics together. */
  harmonics(state, show, matrix) {
    const { gl, model } = this
    const layers = model.harmonics
    const codes = show === 'vertices' ? 'vertexCodes' : 'codes'
    const name = `harmonics ${codes}`
    this.programs.harmonics ??= harmonics(gl, layers.length)
    if (!this.arrays.has(name)) {
      const array = gl.createVertexArray()
      gl.bindVertexArray(array)
      const attribute = (location, section, size, type, normalized, stride) => {
        gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer(section))
        gl.enableVertexAttribArray(location)
        gl.vertexAttribPointer(location, size, type, normalized, stride, 0)
      }
      attribute(ATTRIBUTES.position, 'positions', 3, gl.FLOAT, false, 12)
      attribute(ATTRIBUTES.normal, 'normals', 3, gl.BYTE, true, 4)
      attribute(ATTRIBUTES.base, 'baseColors', 3, gl.UNSIGNED_BYTE, true, 4)
      layers.forEach((layer, k) => attribute(ATTRIBUTES.code + k, `${codes}${layer}`, 2, gl.UNSIGNED_SHORT, false, 4))
      this.arrays.set(name, array)
    }
    gl.bindVertexArray(this.arrays.get(name))
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.indices.buffer)
    const { made, uniforms } = this.programs.harmonics
    gl.useProgram(made)
    gl.uniformMatrix4fv(uniforms.clipFromWorld, false, matrix)
    layers.forEach((layer, k) => {
      gl.activeTexture(gl.TEXTURE0 + k)
      // A unit has a place for each kind of texture: a table that stands there stays.
      gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.layers[layer].atlas)
      gl.uniform1i(uniforms[`atlas${k}`], k)
      gl.uniform3fv(uniforms[`scale${k}`], model.about.layers[layer].scale)
    })
    gl.uniform1i(uniforms.materials, state.materials ? 1 : 0)
    gl.uniform1f(uniforms.exposure, 2 ** state.exposure)
  }

  view(uniforms, { clipFromWorld, inAtlas, atlasView }) {
    const { gl } = this
    gl.uniformMatrix4fv(uniforms.clipFromWorld, false, clipFromWorld)
    gl.uniform1i(uniforms.inAtlas, inAtlas)
    gl.uniform4fv(uniforms.atlasView, atlasView)
  }

  light(uniforms, about, state) {
    const { gl } = this
    const { atlas, table } = this.layers[state.layer]
    gl.activeTexture(gl.TEXTURE0)
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, atlas)
    gl.uniform1i(uniforms.atlas, 0)
    gl.activeTexture(gl.TEXTURE1)
    gl.bindTexture(gl.TEXTURE_2D, table)
    gl.uniform1i(uniforms.table ?? null, 1)
    gl.uniform3fv(uniforms.scale, about.scale)
    gl.uniform2fv(uniforms.ends, about.clamp ?? about.range)
    gl.uniform1i(uniforms.one, about.channels === 1 ? 1 : 0)
    gl.uniform1i(uniforms.isSigned, about.range[0] < 0 ? 1 : 0)
    gl.uniform1f(uniforms.exposure, about.white > 0 ? 2 ** state.exposure : 1)
  }

  /** Single-sided triangles come first. */
  triangles({ count }) {
    const { gl, model } = this
    const single = 3 * model.about.singleSided
    gl.enable(gl.CULL_FACE)
    if (single > 0) gl.drawElements(gl.TRIANGLES, single, gl.UNSIGNED_INT, 0)
    gl.disable(gl.CULL_FACE)
    if (count > single) gl.drawElements(gl.TRIANGLES, count - single, gl.UNSIGNED_INT, 4 * single)
  }

  lines(view, paint, pull) {
    const { gl } = this
    this.vertices('codes0')
    const { made, uniforms } = this.programs.line
    gl.useProgram(made)
    this.view(uniforms, view)
    gl.uniform4fv(uniforms.paint, paint)
    gl.uniform1f(uniforms.pull, pull)
    gl.enable(gl.BLEND)
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA)
    gl.depthMask(false)
  }

  linesDone() {
    const { gl } = this
    gl.disable(gl.BLEND)
    gl.depthMask(true)
  }

  errors(state, matrix) {
    const { gl, canvas, model } = this
    if (!this.points) {
      this.points = gl.createVertexArray()
      gl.bindVertexArray(this.points)
      for (const [name, section, type, stride] of [['position', 'errors', gl.FLOAT, 16], ['normal', 'errorNormals', gl.BYTE, 4]]) {
        gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer(section))
        gl.enableVertexAttribArray(ATTRIBUTES[name])
        gl.vertexAttribPointer(ATTRIBUTES[name], 4, type, type === gl.BYTE, stride, 0)
      }
    }
    gl.bindVertexArray(this.points)
    const { made, uniforms } = this.programs.error
    gl.useProgram(made)
    gl.uniformMatrix4fv(uniforms.clipFromWorld, false, matrix)
    gl.uniform3fv(uniforms.eye, state.camera.eye())
    gl.uniform1f(uniforms.pixels, Camera.pixels(Math.min(canvas.width, canvas.height)))
    gl.uniform1f(uniforms.spacing, 1.8 * Math.sqrt(model.about.areaPerError))
    gl.uniform1f(uniforms.limit, 2 * model.about.maxError)
    gl.drawArrays(gl.POINTS, 0, model.about.sections.errors.bytes / 16)
  }

  /** How the atlas stands in its box: texels of the stack to the box's clip space. */
  atlasView({ box, middle, zoom }) {
    // Texels a pixel of the page, so that one zoom suits both directions.
    return [...middle, (2 * zoom) / box.width, (-2 * zoom) / box.height]
  }

  atlas(state) {
    const { gl, canvas, model, ratio } = this
    const { box } = state.atlas
    const area = [box.left, this.canvas.clientHeight - box.bottom, box.width, box.height].map((n) => Math.round(n * ratio))
    gl.scissor(...area)
    gl.viewport(...area)
    gl.disable(gl.DEPTH_TEST)
    gl.disable(gl.CULL_FACE)
    const atlasView = this.atlasView(state.atlas)
    const view = { clipFromWorld: state.camera.clipFromWorld(canvas.width, canvas.height), inAtlas: 1, atlasView }
    const { made, uniforms } = this.programs.atlas
    gl.useProgram(made)
    this.vertices('codes0')
    this.light(uniforms, model.about.layers[state.layer], state)
    gl.uniform4fv(uniforms.atlasView, atlasView)
    gl.uniform1f(uniforms.dim, state.overlay === 'none' ? 1 : 0.35)
    gl.drawArrays(gl.TRIANGLES, 0, 3)
    this.inAtlas ??= this.indexBuffer(model.textureIndices)
    if (['classes', 'charts', 'density'].includes(state.overlay)) {
      this.surface({ ...state, materials: false }, 'hybrid', view)
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.inAtlas.buffer)
      gl.drawElements(gl.TRIANGLES, this.inAtlas.count, gl.UNSIGNED_INT, 0)
    }
    if (state.wireframe || state.overlay === 'none') {
      this.atlasWires ??= this.indexBuffer(model.lines(model.textureIndices))
      this.lines(view, state.wireframe ? [1, 0.55, 0.1, 0.9] : [1, 0.55, 0.1, 0.35], 0)
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.atlasWires.buffer)
      gl.drawElements(gl.LINES, this.atlasWires.count, gl.UNSIGNED_INT, 0)
    }
    if (state.picked && model.kind(state.picked.triangle) === 'texture') {
      this.lines(view, [0.1, 0.9, 1, 0.45], 0)
      gl.drawElements(gl.TRIANGLES, 3, gl.UNSIGNED_INT, 12 * state.picked.triangle)
      this.lines(view, [0.1, 0.9, 1, 1], 0)
      gl.drawElements(gl.LINE_LOOP, 3, gl.UNSIGNED_INT, 12 * state.picked.triangle)
    }
    this.linesDone()
    gl.viewport(0, 0, canvas.width, canvas.height)
  }

  /**
   * What lies under a place of the page: a triangle and the weights of its corners.
   * - `x`, `y`: in pixels of the page; within the atlas's box the atlas is asked
   */
  pick(state, x, y, inAtlas) {
    const { gl, canvas, model, ratio } = this
    if (inAtlas && !model.hasAtlas) return undefined
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.picking)
    const area = inAtlas ? state.atlas.box : { left: 0, bottom: canvas.clientHeight, width: canvas.clientWidth, height: canvas.clientHeight }
    const [left, down] = [Math.round((x - area.left) * ratio), Math.round((area.bottom - y) * ratio)]
    // The one pixel that is asked for is the first of the target.
    gl.viewport(-left, -down, Math.round(area.width * ratio), Math.round(area.height * ratio))
    gl.disable(gl.SCISSOR_TEST)
    gl.disable(gl.BLEND)
    gl.depthMask(true)
    gl.clearBufferuiv(gl.COLOR, 0, [0, 0, 0, 0])
    gl.clearBufferfi(gl.DEPTH_STENCIL, 0, 1, 0)
    this.vertices('codes0')
    const { made, uniforms } = this.programs.pick
    gl.useProgram(made)
    const clipFromWorld = state.camera.clipFromWorld(canvas.width, canvas.height)
    this.view(uniforms, { clipFromWorld, inAtlas: inAtlas ? 1 : 0, atlasView: inAtlas ? this.atlasView(state.atlas) : [0, 0, 1, 1] })
    if (inAtlas) {
      gl.disable(gl.DEPTH_TEST)
      gl.disable(gl.CULL_FACE)
      this.inAtlas ??= this.indexBuffer(model.textureIndices)
      this.vertices('codes0')
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.inAtlas.buffer)
      gl.drawElements(gl.TRIANGLES, this.inAtlas.count, gl.UNSIGNED_INT, 0)
    } else {
      gl.enable(gl.DEPTH_TEST)
      this.triangles(this.indices)
    }
    const found = new Uint32Array(4)
    gl.readPixels(0, 0, 1, 1, gl.RGBA_INTEGER, gl.UNSIGNED_INT, found)
    gl.bindFramebuffer(gl.FRAMEBUFFER, null)
    if (found[0] === 0) return undefined
    const at = [...new Float32Array(found.buffer, 4, 3)]
    const where = inAtlas ? (v) => model.place(v) : (v) => model.position(v)
    return model.triangleAt(found[0] - 1, inAtlas ? at.slice(0, 2) : at, where)
  }
}
