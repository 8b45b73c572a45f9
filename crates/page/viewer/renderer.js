// Draws a model with WebGL 2: two ways of showing it left and right of a divider, the atlas in a corner, and what lies
// under the pointer.

import { Camera } from './camera.js'
import { ATTRIBUTES, harmonics, programs } from './shaders.js'

const OVERLAYS = ['none', 'classes', 'charts', 'density', 'error']
const SOURCES = { hybrid: 0, vertices: 0, full: 0, fallback: 1, none: 2 }
const CODES = { vertices: 'vertexCodes', full: 'fullCodes' }
const GEOMETRY = ['positions', 'normals', 'baseColors', 'uvs']
// That of the program's own pictures: linear 0.28, 0.32, 0.38.
const BACKGROUND = [0.5666, 0.6030, 0.6516, 1]

export class Renderer {
  constructor(canvas, model) {
    const gl = canvas.getContext('webgl2', { antialias: true, powerPreference: 'high-performance' })
    if (!gl) throw new Error('this browser has no WebGL 2')
    Object.assign(this, { gl, canvas, pictures: new Map(), arrays: new Map(), buffers: new Map(), ownBuffers: [], ownTextures: [] })
    this.programs = programs(gl)
    this.picking = this.pickTarget()
    // Where there are no charts.
    gl.vertexAttribI4ui(ATTRIBUTES.chart, 0, 0, 0, 0)
    this.white = this.plain([255, 255, 255, 255])
    this.show(model)
  }

  /** Takes another model in the place of the one before. Pictures of surfaces stay: they have the same names. */
  show(model) {
    const { gl } = this
    for (const array of this.arrays.values()) gl.deleteVertexArray(array)
    for (const buffer of [...this.buffers.values(), ...this.ownBuffers]) gl.deleteBuffer(buffer)
    for (const texture of this.ownTextures) gl.deleteTexture(texture)
    Object.assign(this, { model, arrays: new Map(), buffers: new Map(), ownBuffers: [], ownTextures: [], wires: undefined, points: undefined, inAtlas: undefined, atlasWires: undefined })
    this.layers = model.about.layers.map((layer, number) => this.images(layer, number))
    this.indices = this.indexBuffer(model.indices)
    this.textures = model.about.textures.map((texture) => this.picture(texture))
  }

  /** A texture that goes with the model. */
  ownTexture() {
    const texture = this.gl.createTexture()
    this.ownTextures.push(texture)
    return texture
  }

  /** A texture of one texel. */
  plain(color) {
    const { gl } = this
    const texture = gl.createTexture()
    gl.bindTexture(gl.TEXTURE_2D, texture)
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.SRGB8_ALPHA8, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(color))
    return texture
  }

  /** A picture on a surface: white until it is there, and for good if it cannot be had. */
  picture({ image, wrap }) {
    const { gl } = this
    const key = [image, ...wrap].join()
    if (!this.pictures.has(key)) {
      const made = { texture: this.white }
      this.pictures.set(key, made)
      this.fetchPicture(image, wrap).then((texture) => {
        made.texture = texture
        this.arrived?.()
      }, () => {})
    }
    return this.pictures.get(key)
  }

  async fetchPicture(name, wrap) {
    const { gl } = this
    const response = await fetch(name)
    if (!response.ok) throw new Error(`${name}: ${response.status}`)
    const options = { premultiplyAlpha: 'none', colorSpaceConversion: 'none' }
    let bitmap = await createImageBitmap(await response.blob(), options)
    // More than a screen shows; a file with sixty pictures of 4096² would fill the memory of a phone.
    const most = Math.min(2048, gl.getParameter(gl.MAX_TEXTURE_SIZE))
    const shrink = most / Math.max(bitmap.width, bitmap.height)
    if (shrink < 1) {
      const [resizeWidth, resizeHeight] = [bitmap.width, bitmap.height].map((n) => Math.max(1, Math.round(n * shrink)))
      bitmap = await createImageBitmap(bitmap, { ...options, resizeWidth, resizeHeight, resizeQuality: 'high' })
    }
    const texture = gl.createTexture()
    gl.activeTexture(gl.TEXTURE2)
    gl.bindTexture(gl.TEXTURE_2D, texture)
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.SRGB8_ALPHA8, gl.RGBA, gl.UNSIGNED_BYTE, bitmap)
    bitmap.close()
    gl.generateMipmap(gl.TEXTURE_2D)
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR)
    const ways = { clamp: gl.CLAMP_TO_EDGE, mirror: gl.MIRRORED_REPEAT, repeat: gl.REPEAT }
    ;[gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T].forEach((side, k) => gl.texParameteri(gl.TEXTURE_2D, side, ways[wrap[k]]))
    return texture
  }

  buffer(name) {
    const { gl, model } = this
    if (!this.buffers.has(name)) {
      const buffer = gl.createBuffer()
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer)
      gl.bufferData(gl.ARRAY_BUFFER, GEOMETRY.includes(name) ? model.vertexData(name) : model.numbers(name, Uint8Array), gl.STATIC_DRAW)
      this.buffers.set(name, buffer)
    }
    return this.buffers.get(name)
  }

  indexBuffer(indices) {
    const { gl } = this
    gl.bindVertexArray(null)
    const buffer = gl.createBuffer()
    this.ownBuffers.push(buffer)
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
        if (name === 'chart') gl.vertexAttribIPointer(ATTRIBUTES[name], size, type, stride, 0)
        else gl.vertexAttribPointer(ATTRIBUTES[name], size, type, normalized, stride, 0)
      }
      attribute('position', 'positions', 3, gl.FLOAT, false, 12)
      attribute('normal', 'normals', 3, gl.BYTE, true, 4)
      attribute('base', 'baseColors', 4, gl.UNSIGNED_BYTE, true, 4)
      if (model.has('uvs')) attribute('uv', 'uvs', 2, gl.FLOAT, false, 8)
      if (model.has('charts')) attribute('chart', 'charts', 1, model.chartBytes === 2 ? gl.UNSIGNED_SHORT : gl.UNSIGNED_INT, false, model.chartBytes)
      attribute('code', codes, 2, gl.UNSIGNED_SHORT, false, 4)
      if (model.has('fallback')) attribute('fallback', 'fallback', 3, gl.UNSIGNED_BYTE, true, 4)
      this.arrays.set(codes, array)
    }
    gl.bindVertexArray(this.arrays.get(codes))
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.indices.buffer)
  }

  /** The pages of a layer as an array of textures, those of its full lightmap, and its table. */
  images(layer, number) {
    const { gl, model } = this
    const one = layer.numbers === 1
    const atlas = this.pages(layer, `page${number}`, layer.pages, model.about.pageSize, layer.bits === 16)
    const full = layer.fullPages ? this.pages(layer, `full${number}`, layer.fullPages, model.about.fullSize, false) : atlas
    const table = this.ownTexture()
    gl.bindTexture(gl.TEXTURE_2D, table)
    const colors = layer.form === 'table' ? model.numbers(`table${number}`, Uint8Array) : new Uint8Array(layer.numbers)
    const columns = layer.form === 'table' ? 256 : 1
    const rows = colors.length / layer.numbers / columns
    // A table of one channel is read in all three.
    const rgb = one ? Uint8Array.from({ length: colors.length * 3 }, (_, i) => colors[Math.floor(i / 3)]) : colors
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, columns, rows, 0, gl.RGB, gl.UNSIGNED_BYTE, rgb)
    this.filter(gl.TEXTURE_2D, gl.NEAREST)
    return { atlas, full, table }
  }

  /** Pages as an array of textures. */
  pages(layer, name, count, size, deep) {
    const { gl, model } = this
    const [width, height] = count ? size : [1, 1]
    const one = layer.numbers === 1
    const pages = Math.max(1, count)
    const limit = gl.getParameter(gl.MAX_TEXTURE_SIZE)
    const most = gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS)
    if (Math.max(width, height) > limit || pages > most) {
      throw new Error(`the atlas has ${pages} pages of ${width} × ${height}, and this browser takes ${most} of ${limit} × ${limit}`)
    }
    const atlas = this.ownTexture()
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, atlas)
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1)
    const inside = deep ? (one ? gl.R16F : gl.RGB16F) : one ? gl.R8 : gl.RGB8
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, inside, width, height, pages)
    for (let page = 0; page < count; page++) {
      const texels = model.numbers(`${name}_${page}`, deep ? Uint16Array : Uint8Array)
      const values = deep ? Float32Array.from(texels, (t) => t / 65535) : texels
      gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, page, width, height, 1, one ? gl.RED : gl.RGB, deep ? gl.FLOAT : gl.UNSIGNED_BYTE, values)
    }
    this.filter(gl.TEXTURE_2D_ARRAY, gl.LINEAR)
    return atlas
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
    const together = state.harmonics && state.overlay === 'none' && (show === 'hybrid' || show in CODES)
    this.triangles(together ? this.harmonics(state, show, matrix) : this.surface(state, show, view))
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

  /** Binds what a surface is drawn with, and returns the uniforms. */
  surface(state, show, view) {
    const { gl, model } = this
    const about = model.about.layers[state.layer]
    const alone = show in CODES
    this.vertices(`${CODES[show] ?? 'codes'}${state.layer}`)
    const { made, uniforms } = this.programs.surface
    gl.useProgram(made)
    this.view(uniforms, view)
    this.light(uniforms, about, state, show === 'full')
    const form = alone && about.form === 'table' ? (about.channels === 1 ? 'scalar' : 'rgb') : about.form
    gl.uniform1i(uniforms.form, ['scalar', 'rgb', 'table'].indexOf(form))
    gl.uniform1i(uniforms.source, SOURCES[show])
    gl.uniform1i(uniforms.overlay, OVERLAYS.indexOf(state.overlay))
    gl.uniform1i(uniforms.materials, state.materials ? 1 : 0)
    gl.uniform1f(uniforms.texelSize, model.about.texelSize)
    gl.uniform3fv(uniforms.eye, state.camera.eye())
    return uniforms
  }

  /** As `surface`, of all layers of harmonics together. */
  harmonics(state, show, matrix) {
    const { gl, model } = this
    const layers = model.harmonics
    const codes = CODES[show] ?? 'codes'
    const name = `harmonics ${codes}`
    const program = (this.programs[`harmonics${layers.length}`] ??= harmonics(gl, layers.length))
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
      attribute(ATTRIBUTES.base, 'baseColors', 4, gl.UNSIGNED_BYTE, true, 4)
      if (model.has('uvs')) attribute(ATTRIBUTES.uv, 'uvs', 2, gl.FLOAT, false, 8)
      layers.forEach((layer, k) => attribute(ATTRIBUTES.code + k, `${codes}${layer}`, 2, gl.UNSIGNED_SHORT, false, 4))
      this.arrays.set(name, array)
    }
    gl.bindVertexArray(this.arrays.get(name))
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.indices.buffer)
    const { made, uniforms } = program
    gl.useProgram(made)
    gl.uniformMatrix4fv(uniforms.clipFromWorld, false, matrix)
    layers.forEach((layer, k) => {
      gl.activeTexture(gl.TEXTURE0 + k)
      // A unit has a place for each kind of texture: a table that stands there stays.
      gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.layers[layer][show === 'full' ? 'full' : 'atlas'])
      gl.uniform1i(uniforms[`atlas${k}`], k)
      gl.uniform3fv(uniforms[`scale${k}`], model.about.layers[layer].scale)
    })
    gl.uniform1i(uniforms.materials, state.materials ? 1 : 0)
    gl.uniform1f(uniforms.exposure, 2 ** state.exposure)
    return uniforms
  }

  view(uniforms, { clipFromWorld, inAtlas, atlasView }) {
    const { gl } = this
    gl.uniformMatrix4fv(uniforms.clipFromWorld, false, clipFromWorld)
    gl.uniform1i(uniforms.inAtlas, inAtlas)
    gl.uniform4fv(uniforms.atlasView, atlasView)
  }

  light(uniforms, about, state, full) {
    const { gl } = this
    const { atlas, full: over, table } = this.layers[state.layer]
    gl.activeTexture(gl.TEXTURE0)
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, full ? over : atlas)
    gl.uniform1i(uniforms.atlas, 0)
    gl.activeTexture(gl.TEXTURE1)
    gl.bindTexture(gl.TEXTURE_2D, table)
    gl.uniform1i(uniforms.table ?? null, 1)
    gl.uniform3fv(uniforms.scale, about.scale)
    gl.uniform2fv(uniforms.ends, about.clamp ?? about.range)
    gl.uniform1i(uniforms.one, about.channels === 1 ? 1 : 0)
    gl.uniform1i(uniforms.isSigned, about.range[0] < 0 ? 1 : 0)
    gl.uniform1f(uniforms.exposure, 2 ** state.exposure)
  }

  /** Draws the triangles, group after group. */
  triangles(uniforms) {
    const { gl, model } = this
    // The unit behind those of light; harmonics have up to nine.
    const unit = 9
    gl.activeTexture(gl.TEXTURE0 + unit)
    gl.uniform1i(uniforms.picture ?? null, unit)
    let first = 0
    for (const { triangles, doubleSided, texture, cutoff } of model.about.groups) {
      gl.bindTexture(gl.TEXTURE_2D, texture === null ? this.white : this.textures[texture].texture)
      gl.uniform1f(uniforms.cutoff ?? null, cutoff)
      if (doubleSided) gl.disable(gl.CULL_FACE)
      else gl.enable(gl.CULL_FACE)
      gl.drawElements(gl.TRIANGLES, 3 * triangles, gl.UNSIGNED_INT, 12 * first)
      first += triangles
    }
    gl.disable(gl.CULL_FACE)
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
      this.triangles(uniforms)
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
