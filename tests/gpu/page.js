// Draws `cases` with `shaders` and compares; see page.rs. `globalThis.result` is, for each program and curve, the
// largest difference in stored units and how many pixels were compared. `plain` programs are those for an atlas of one page
// without mip levels: all pages, one under the other.

const gl = document.createElement('canvas').getContext('webgl2')

const stack = [size[0], size[1] * pages]
const PLAIN = '#define LIGHTKILN_ONE_PAGE\n#define LIGHTKILN_ONE_LEVEL\n'

function program(name, isPlain) {
  const [vertex, fragment] = { table: ['table', 'rgb'], interop: ['interop', 'scalar'], clamped: ['scalar', 'clamped'] }[name] ?? [name, name]
  const linked = gl.createProgram()
  for (const [stage, kind, main] of [['vert', gl.VERTEX_SHADER, vertex], ['frag', gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind)
    const head = `#version 300 es\nprecision highp float;\n${isPlain ? PLAIN : ''}`
    gl.shaderSource(shader, head + shaders[`lightkiln.${stage}.glsl`] + shaders[`programs/${main}.${stage}.glsl`])
    gl.compileShader(shader)
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw Error(name + gl.getShaderInfoLog(shader))
    gl.attachShader(linked, shader)
  }
  gl.linkProgram(linked)
  if (!gl.getProgramParameter(linked, gl.LINK_STATUS)) throw Error(name + gl.getProgramInfoLog(linked))
  return linked
}

function texture(target, [min, mag], upload) {
  const made = gl.createTexture()
  gl.bindTexture(target, made)
  upload()
  gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, min)
  gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, mag)
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(target, name, gl.CLAMP_TO_EDGE)
  return made
}

function atlas({ channels, levels }) {
  const [stored, format] = channels === 1 ? [gl.R8, gl.RED] : [gl.RGB8, gl.RGB]
  const kind = gl.TEXTURE_2D_ARRAY
  return texture(kind, [gl.LINEAR_MIPMAP_LINEAR, gl.LINEAR], () => {
    gl.texStorage3D(kind, levels.length, stored, ...size, pages)
    levels.forEach((texels, level) => {
      const [width, height] = size.map((n) => n >> level)
      gl.texSubImage3D(kind, level, 0, 0, 0, width, height, pages, format, gl.UNSIGNED_BYTE, new Uint8Array(texels))
    })
  })
}

function plainAtlas({ channels, levels: [texels] }) {
  const [stored, format] = channels === 1 ? [gl.R8, gl.RED] : [gl.RGB8, gl.RGB]
  return texture(gl.TEXTURE_2D, [gl.LINEAR, gl.LINEAR], () =>
    gl.texImage2D(gl.TEXTURE_2D, 0, stored, ...stack, 0, format, gl.UNSIGNED_BYTE, new Uint8Array(texels)))
}

/** The curve of a layer, as lightkiln_light::Scale has it. */
const perceived = (x, white) => (white > 0 ? (Math.sign(x) * Math.log1p((15 * Math.abs(x)) / white)) / Math.log(16) : x)

function run() {
  if (!gl.getExtension('EXT_color_buffer_float')) throw Error('no float targets')
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1)
  const made = [atlas, plainAtlas].map((make) => ({ grey: make(textures.grey), colored: textures.colored.map(make) }))
  const nearest = [gl.NEAREST, gl.NEAREST]
  const table = texture(gl.TEXTURE_2D, nearest, () =>
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, ...textures.table_size, 0, gl.RGB, gl.UNSIGNED_BYTE, new Uint8Array(textures.table)))
  const target = texture(gl.TEXTURE_2D, nearest, () => gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, pixels, pixels))
  gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer())
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0)
  gl.viewport(0, 0, pixels, pixels)
  const programs = {}
  const results = {}
  for (const [test, isPlain] of cases.flatMap((test) => [[test, false], [test, true]])) {
    const name = isPlain ? `${test.program} plain` : test.program
    const used = (programs[name] ??= program(test.program, isPlain))
    const { grey, colored } = made[Number(isPlain)]
    const kind = isPlain ? gl.TEXTURE_2D : gl.TEXTURE_2D_ARRAY
    gl.useProgram(used)
    const uniform = (name) => gl.getUniformLocation(used, name)
    const sampler = (name, unit, kind, bound) => {
      gl.activeTexture(gl.TEXTURE0 + unit)
      gl.bindTexture(kind, bound)
      gl.uniform1i(uniform(name), unit)
    }
    gl.uniformMatrix4fv(uniform('u_clip_from_object'), false, [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])
    gl.uniform2f(uniform('u_stack'), ...stack)
    gl.uniform2f(uniform('u_page'), ...(isPlain ? stack : size))
    gl.uniform2fv(uniform('u_clamp'), test.ends)
    if (test.program === 'sh') {
      gl.uniform3fv(uniform('u_scale'), [0, 1, 2, 3].flatMap(() => test.scale))
      colored.forEach((bound, i) => sampler(`u_atlas_${i}`, i, kind, bound))
    } else {
      gl.uniform3fv(uniform('u_scale'), test.scale)
      sampler('u_atlas', 0, kind, ['rgb', 'table'].includes(test.program) ? colored[0] : grey)
    }
    if (test.program === 'table') sampler('u_table', 5, gl.TEXTURE_2D, table)
    for (let i = 0; i < 8; i++) gl.disableVertexAttribArray(i)
    const attribute = (name, count, values, kind) => {
      const at = gl.getAttribLocation(used, name)
      if (at < 0) return
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer())
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW)
      gl.enableVertexAttribArray(at)
      gl.vertexAttribPointer(at, count, kind, false, 0, 0)
    }
    attribute('a_position', 3, new Float32Array(test.positions.flatMap(([x, y]) => [x, y, 0])), gl.FLOAT)
    attribute('a_normal', 3, new Float32Array(test.positions.flatMap(() => test.normal)), gl.FLOAT)
    test.attributes.map((pairs) => pairs.flat()).forEach((pairs, i) => {
      attribute('a_texcoord', 2, new Float32Array(pairs), gl.FLOAT)
      attribute(i ? `a_lightuv_${i}` : 'a_lightuv', 2, new Uint16Array(pairs), gl.UNSIGNED_SHORT)
    })
    gl.clear(gl.COLOR_BUFFER_BIT)
    gl.drawArrays(gl.TRIANGLES, 0, test.positions.length)
    const drawn = new Float32Array(pixels * pixels * 4)
    gl.readPixels(0, 0, pixels, pixels, gl.RGBA, gl.FLOAT, drawn)
    const [, extent, white] = test.scale
    const result = (results[`${name} ${white ? 'log' : 'linear'}`] ??= { largest: 0, compared: 0 })
    const pictures = isPlain ? test.plain : test.expected
    pictures.forEach((expected, pixel) => expected?.forEach((light, channel) => {
      const difference = Math.abs(perceived(drawn[4 * pixel + channel], white) - perceived(light, white)) / extent
      result.largest = Math.max(result.largest, Number.isNaN(difference) ? Infinity : difference)
      result.compared++
    }))
  }
  if (gl.getError()) throw Error('a GL error')
  return results
}

try {
  globalThis.result = run()
  const debug = gl.getExtension('WEBGL_debug_renderer_info')
  globalThis.renderer = gl.getParameter(debug ? debug.UNMASKED_RENDERER_WEBGL : gl.RENDERER)
  const lines = Object.entries(result).map(([name, { largest, compared }]) =>
    `${largest <= bound ? 'as the CPU' : 'WRONG'}  ${name}: off by ${largest.toExponential(1)} at most, of ${compared} numbers`)
  document.getElementById('result').textContent = [renderer, ...lines].join('\n')
} catch (error) {
  globalThis.failure = String(error)
  document.getElementById('result').textContent = `failed: ${error}`
}
globalThis.ready = true
