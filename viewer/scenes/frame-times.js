// Draws the same triangles with no light, with light at vertices, with a lightmap and with the shaders of shaders/, and takes
// the times; and again as occlusion in a material of three.js. `globalThis.prepare(job)` and then
// `globalThis.frames(way, repeats)` are called by frame-times.mjs.

import * as THREE from 'three'
import { RoomEnvironment } from 'three/addons/environments/RoomEnvironment.js'
import { COLOR_FLAG, SUBTEXELS } from 'lightkiln-format'
import { Light } from 'three-lightkiln'

const canvas = document.querySelector('canvas')
const gl = canvas.getContext('webgl2', { antialias: false, preserveDrawingBuffer: true })

const text = async (path) => (await fetch(path)).text()
const numbers = async (name) => (await fetch(`/files/${name}`)).arrayBuffer()

const [ours, main, oursFragment] = await Promise.all(
  ['lightkiln.vert.glsl', 'programs/scalar.vert.glsl', 'lightkiln.frag.glsl'].map((file) => text(`/shaders/${file}`)))

/** As shaders/README.md has it, and as the packages do. */
const ONE_LEVEL = '#define LIGHTKILN_ONE_LEVEL\n'
const ONE_PAGE = '#define LIGHTKILN_ONE_PAGE\n'

const PLAIN_VERTEX = `
uniform mat4 u_clip_from_object;
in vec3 a_position;
in vec2 a_attribute;
out vec2 v_attribute;
void main() {
  v_attribute = a_attribute;
  gl_Position = u_clip_from_object * vec4(a_position, 1.0);
}`
const plainFragment = (declaration, light) => `
${declaration}
in vec2 v_attribute;
out vec4 o_color;
void main() {
  o_color = vec4(vec3(${light}), 1.0);
}`
/** Occlusion is stored as it is shown, so neither way has a curve to undo. */
const OCCLUSION = `
uniform LIGHTKILN_ATLAS u_atlas;
in vec3 v_place;
in float v_color;
out vec4 o_color;
void main() {
  o_color = vec4(vec3(lightkilnLightScalar(u_atlas, v_color, v_place)), 1.0);
}`
const LIGHTMAP = plainFragment('uniform highp sampler2D u_lightmap;', 'texture(u_lightmap, v_attribute).r')

/** Each way: its mesh, vertex stage, fragment stage, and which of the textures. Those of grids and levels are drawn when they are asked for. */
const WAYS = {
  nothing: { mesh: 'hybrid', vertex: PLAIN_VERTEX, fragment: plainFragment('', '1.0') },
  vertices: { mesh: 'hybrid', vertex: PLAIN_VERTEX, fragment: plainFragment('', 'v_attribute.x / 65535.0') },
  lightmap: { mesh: 'lightmap', vertex: PLAIN_VERTEX, fragment: LIGHTMAP, texture: 'lightmap' },
  hybrid: { mesh: 'hybrid', vertex: ours + main, fragment: ONE_LEVEL + oursFragment + OCCLUSION, texture: 'atlas' },
  'fill, nothing': { mesh: 'mapped grid', vertex: PLAIN_VERTEX, fragment: plainFragment('', '1.0') },
  'fill, lightmap': { mesh: 'mapped grid', vertex: PLAIN_VERTEX, fragment: LIGHTMAP, texture: 'lightmap' },
  'fill, lightmap again': { mesh: 'mapped grid', vertex: PLAIN_VERTEX, fragment: LIGHTMAP, texture: 'lightmap' },
  'fill, texels': { mesh: 'texel grid', vertex: ours + main, fragment: ONE_LEVEL + oursFragment + OCCLUSION, texture: 'atlas' },
  'fill, colors': { mesh: 'color grid', vertex: ours + main, fragment: ONE_LEVEL + oursFragment + OCCLUSION, texture: 'atlas' },
  'lightmap, levels': { mesh: 'lightmap', vertex: PLAIN_VERTEX, fragment: LIGHTMAP, texture: 'lightmapLevels' },
  'hybrid, levels': { mesh: 'hybrid', vertex: ours + main, fragment: oursFragment + OCCLUSION, texture: 'atlasLevels' },
}

const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]

function program({ vertex, fragment }) {
  const linked = gl.createProgram()
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind)
    gl.shaderSource(shader, `#version 300 es\nprecision highp float;\n${source}`)
    gl.compileShader(shader)
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw Error(gl.getShaderInfoLog(shader))
    gl.attachShader(linked, shader)
  }
  gl.bindAttribLocation(linked, 0, 'a_position')
  gl.bindAttribLocation(linked, 1, vertex === PLAIN_VERTEX ? 'a_attribute' : 'a_lightuv')
  gl.linkProgram(linked)
  if (!gl.getProgramParameter(linked, gl.LINK_STATUS)) throw Error(gl.getProgramInfoLog(linked))
  return linked
}

async function loaded(name) {
  const [positions, attributes, indices] = await Promise.all(['positions', 'attributes', 'indices'].map((part) => numbers(`${name}.${part}`)))
  return { positions: new Float32Array(positions), attributes: new Uint16Array(attributes), indices: new Uint32Array(indices) }
}

/** Triangles that fill the picture once; `attributeAt`: of a place in the unit square. */
function grid(attributeAt) {
  const [steps, positions, attributes, indices] = [16, [], [], []]
  for (let y = 0; y <= steps; y++) {
    for (let x = 0; x <= steps; x++) {
      positions.push((2 * x) / steps - 1, (2 * y) / steps - 1, 0)
      attributes.push(...attributeAt(x / steps, y / steps).map(Math.round))
      const at = positions.length / 3 - 1
      if (x < steps && y < steps) indices.push(at, at + 1, at + steps + 1, at + 1, at + steps + 2, at + steps + 1)
    }
  }
  return { positions: new Float32Array(positions), attributes: new Uint16Array(attributes), indices: new Uint32Array(indices) }
}

function mesh({ positions, attributes, indices }, isNormalized) {
  const array = gl.createVertexArray()
  gl.bindVertexArray(array)
  const buffer = (data, target) => {
    gl.bindBuffer(target, gl.createBuffer())
    gl.bufferData(target, data, gl.STATIC_DRAW)
  }
  const attribute = (at, size, data, kind, isNormalized) => {
    buffer(data, gl.ARRAY_BUFFER)
    gl.enableVertexAttribArray(at)
    gl.vertexAttribPointer(at, size, kind, isNormalized, 0, 0)
  }
  attribute(0, 3, positions, gl.FLOAT, false)
  attribute(1, 2, attributes, gl.UNSIGNED_SHORT, isNormalized)
  buffer(indices, gl.ELEMENT_ARRAY_BUFFER)
  gl.bindVertexArray(null)
  return { array, count: indices.length }
}

/** The pages of a way: one, or an array of them. */
function texture([width, height, count], levels, data) {
  const target = count === 1 ? gl.TEXTURE_2D : gl.TEXTURE_2D_ARRAY
  const made = gl.createTexture()
  gl.bindTexture(target, made)
  if (target === gl.TEXTURE_2D) {
    gl.texStorage2D(target, levels, gl.R8, width, height)
    gl.texSubImage2D(target, 0, 0, 0, width, height, gl.RED, gl.UNSIGNED_BYTE, data)
  } else {
    gl.texStorage3D(target, levels, gl.R8, width, height, count)
    gl.texSubImage3D(target, 0, 0, 0, 0, width, height, count, gl.RED, gl.UNSIGNED_BYTE, data)
  }
  if (levels > 1) gl.generateMipmap(target)
  gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, levels > 1 ? gl.LINEAR_MIPMAP_LINEAR : gl.LINEAR)
  gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, gl.LINEAR)
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(target, name, gl.CLAMP_TO_EDGE)
  return { target, made }
}

/** Milliseconds of `draw`, by the GPU's clock where it has one that pages may read, else until the first pixel is there. */
async function time(gl, draw) {
  const timer = gl.getExtension('EXT_disjoint_timer_query_webgl2')
  const pixel = new Uint8Array(4)
  const query = timer && gl.createQuery()
  const start = performance.now()
  if (timer) gl.beginQuery(timer.TIME_ELAPSED_EXT, query)
  draw()
  if (timer) gl.endQuery(timer.TIME_ELAPSED_EXT)
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel)
  const passed = performance.now() - start
  if (!timer) return passed
  while (!gl.getQueryParameter(query, gl.QUERY_RESULT_AVAILABLE)) await new Promise((resolve) => setTimeout(resolve))
  const elapsed = gl.getQueryParameter(query, gl.QUERY_RESULT) / 1e6
  gl.deleteQuery(query)
  return gl.getParameter(timer.GPU_DISJOINT_EXT) ? time(gl, draw) : elapsed
}

/**
 * A MeshStandardMaterial with an environment and a lamp, dimmed by an aoMap of a lightmap or by the plugin.
 *
 * - returns: for each of the two, a function that draws it with a camera
 */
function inMaterial(sizes, pages, parts) {
  const renderer = new THREE.WebGLRenderer({ antialias: false, preserveDrawingBuffer: true })
  renderer.setSize(canvas.width, canvas.height, false)
  const environment = new THREE.PMREMGenerator(renderer).fromScene(new RoomEnvironment()).texture
  const texture = (name) => {
    const [width, height, count] = sizes[name]
    const made = count === 1 ? new THREE.DataTexture(pages[name], width, height) : new THREE.DataArrayTexture(pages[name], width, height, count)
    const filter = { minFilter: THREE.LinearFilter, magFilter: THREE.LinearFilter, format: THREE.RedFormat, unpackAlignment: 1 }
    return Object.assign(made, filter, { needsUpdate: true })
  }
  const aoMap = texture('lightmap')
  aoMap.channel = 1
  const [width, height, count] = sizes.hybrid
  const light = new Light([{ index: 0, signal: 'ambientOcclusion', attribute: '_LIGHTUV', channels: 1, form: 'scalar', role: 'occlusion',
    scale: { low: 0, extent: 1, white: 0 }, clamp: null, pages: [...Array(count).keys()], atlas: texture('hybrid'), palette: null }], [width, height])
  const camera = new THREE.Camera()
  camera.matrixWorldAutoUpdate = false
  const drawer = (name, attribute, isNormalized, material) => {
    const geometry = new THREE.BufferGeometry()
    geometry.setAttribute('position', new THREE.BufferAttribute(parts[name].positions, 3))
    geometry.setIndex(new THREE.BufferAttribute(parts[name].indices, 1))
    geometry.setAttribute(attribute, new THREE.BufferAttribute(parts[name].attributes, 2, isNormalized))
    geometry.computeVertexNormals()
    const mesh = new THREE.Mesh(geometry, material)
    mesh.frustumCulled = false
    const scene = new THREE.Scene()
    scene.environment = environment
    scene.add(mesh, new THREE.DirectionalLight(0xffffff, 1))
    light.apply(mesh)
    return (clipFromWorld) => {
      camera.projectionMatrix.fromArray(clipFromWorld)
      renderer.render(scene, camera)
    }
  }
  return {
    gl: renderer.getContext(),
    'material, lightmap': drawer('lightmap', 'uv1', true, new THREE.MeshStandardMaterial({ roughness: 0.6, aoMap })),
    'material, hybrid': drawer('hybrid', '_lightuv', false, new THREE.MeshStandardMaterial({ roughness: 0.6 })),
  }
}

/**
 * Loads what there is to draw.
 *
 * - `sizes`: width, height and number of the pages; `withFill`: whether to draw grids, too; `withLevels`: mip levels, too
 * - returns: the names of the ways, and what the pictures and the renderer are
 */
globalThis.prepare = async ({ sizes, cameras, withFill, withLevels }) => {
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1)
  const parts = { hybrid: await loaded('hybrid'), lightmap: await loaded('lightmap') }
  const [width, height] = sizes.hybrid
  const meshes = {
    hybrid: mesh(parts.hybrid, false),
    lightmap: mesh(parts.lightmap, true),
    'mapped grid': mesh(grid((x, y) => [65535 * x, 65535 * y]), true),
    'texel grid': mesh(grid((x, y) => [SUBTEXELS * width * x, SUBTEXELS * height * y]), false),
    'color grid': mesh(grid((x) => [65535 * x, COLOR_FLAG]), false),
  }
  const pages = {}
  for (const [name, [width, height, count]] of Object.entries(sizes)) {
    pages[name] = new Uint8Array(width * height * count)
    for (let i = 0; i < count; i++) pages[name].set(new Uint8Array(await numbers(`${name}.page.${i}`)), i * width * height)
  }
  const of = (name, levels) => texture(sizes[name], levels, pages[name])
  const levels = Math.floor(Math.log2(Math.max(...sizes.lightmap))) + 1
  const textures = { lightmap: of('lightmap', 1), lightmapLevels: of('lightmap', levels), atlas: of('hybrid', 1), atlasLevels: of('hybrid', 2) }
  gl.viewport(0, 0, canvas.width, canvas.height)
  gl.enable(gl.DEPTH_TEST)

  const bind = (way, program) => {
    gl.useProgram(program)
    gl.bindVertexArray(meshes[way.mesh].array)
    if (way.texture !== undefined) gl.bindTexture(textures[way.texture].target, textures[way.texture].made)
    gl.uniform2f(gl.getUniformLocation(program, 'u_page'), ...sizes.hybrid.slice(0, 2))
    return gl.getUniformLocation(program, 'u_clip_from_object')
  }
  const drawn = (way, matrix, camera) => {
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT)
    gl.uniformMatrix4fv(matrix, false, camera)
    gl.drawElements(gl.TRIANGLES, meshes[way.mesh].count, gl.UNSIGNED_INT, 0)
  }

  // Pixels that read the atlas, of those that show anything.
  const share = { ...WAYS.hybrid, fragment: 'in vec3 v_place;\nout vec4 o_color;\nvoid main() { o_color = vec4(v_place.z > 0.0 ? 1.0 : 0.5); }' }
  const matrix = bind(share, program(share))
  const counts = [0, 0]
  for (const camera of cameras) {
    drawn(share, matrix, camera)
    const pixels = new Uint8Array(canvas.width * canvas.height * 4)
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels)
    for (let i = 0; i < pixels.length; i += 4) if (pixels[i] > 0) counts[pixels[i] > 200 ? 1 : 0]++
  }

  const macros = sizes.hybrid[2] === 1 ? ONE_PAGE : ''
  const isDrawn = (name) => (withFill || !name.startsWith('fill')) && (withLevels || !name.endsWith('levels'))
  const ways = Object.entries(WAYS).filter(([name]) => isDrawn(name))
  const programs = Object.fromEntries(ways.map(([name, way]) => [name, program({ ...way, fragment: macros + way.fragment })]))
  const material = inMaterial(sizes, pages, parts)
  /** Milliseconds of a picture of each camera, so many times. */
  globalThis.frames = (name, repeats) => time(material[name] ? material.gl : gl, () => {
    const matrix = material[name] ? null : bind(WAYS[name], programs[name])
    for (let i = 0; i < repeats; i++) {
      for (const camera of cameras) {
        if (material[name]) material[name](camera)
        else drawn(WAYS[name], matrix, WAYS[name].mesh.endsWith('grid') ? IDENTITY : camera)
      }
    }
    if (gl.getError() || material.gl.getError()) throw Error('a GL error')
  })
  const debug = gl.getExtension('WEBGL_debug_renderer_info')
  const renderer = gl.getParameter(debug ? debug.UNMASKED_RENDERER_WEBGL : gl.RENDERER)
  const names = [...ways.map(([name]) => name), ...Object.keys(material).filter((name) => name !== 'gl')]
  return { names, renderer, textured: counts[1] / (counts[0] + counts[1]) }
}
globalThis.ready = true
