// Draws `cases` with `shaders` and compares; see main.rs.
const gl = document.createElement("canvas").getContext("webgl2");

function program(name) {
  const fragment = { table: "rgb", interop: "scalar" }[name] ?? name;
  const linked = gl.createProgram();
  for (const [stage, kind, main] of [["vert", gl.VERTEX_SHADER, name], ["frag", gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    const head = "#version 300 es\nprecision highp float;\n";
    gl.shaderSource(shader, head + shaders[`lightkiln.${stage}.glsl`] + shaders[`programs/${main}.${stage}.glsl`]);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw Error(name + gl.getShaderInfoLog(shader));
    gl.attachShader(linked, shader);
  }
  gl.linkProgram(linked);
  if (!gl.getProgramParameter(linked, gl.LINK_STATUS)) throw Error(name + gl.getProgramInfoLog(linked));
  return linked;
}

function texture(target, filter, upload) {
  const made = gl.createTexture();
  gl.bindTexture(target, made);
  upload();
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(target, name, filter);
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(target, name, gl.CLAMP_TO_EDGE);
  return made;
}

function atlas(texels, stored, format) {
  const kind = gl.TEXTURE_2D_ARRAY;
  return texture(kind, gl.LINEAR, () =>
    gl.texImage3D(kind, 0, stored, ...size, pages, 0, format, gl.UNSIGNED_BYTE, new Uint8Array(texels)));
}

function run() {
  if (!gl.getExtension("EXT_color_buffer_float")) throw Error("no float targets");
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  const greyAtlas = atlas(grey, gl.R8, gl.RED);
  const coloredAtlases = colored.map((texels) => atlas(texels, gl.RGB8, gl.RGB));
  const colors = texture(gl.TEXTURE_2D, gl.NEAREST, () =>
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, ...tableSize, 0, gl.RGB, gl.UNSIGNED_BYTE, new Uint8Array(table)));
  const target = texture(gl.TEXTURE_2D, gl.NEAREST, () =>
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, pixels, pixels));
  gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
  gl.viewport(0, 0, pixels, pixels);
  const programs = {};
  const largest = {};
  for (const test of cases) {
    const used = (programs[test.program] ??= program(test.program));
    gl.useProgram(used);
    const uniform = (name) => gl.getUniformLocation(used, name);
    const sampler = (name, unit, kind, bound) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(kind, bound);
      gl.uniform1i(uniform(name), unit);
    };
    gl.uniformMatrix4fv(uniform("u_clip_from_object"), false, [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
    gl.uniform2f(uniform("u_stack"), size[0], size[1] * pages);
    if (test.program === "sh") {
      gl.uniform3fv(uniform("u_scale"), [0, 1, 2, 3].flatMap(() => test.scale));
      coloredAtlases.forEach((bound, i) => sampler(`u_atlas_${i}`, i, gl.TEXTURE_2D_ARRAY, bound));
    } else {
      gl.uniform3fv(uniform("u_scale"), test.scale);
      const isGrey = test.program === "scalar" || test.program === "interop";
      sampler("u_atlas", 0, gl.TEXTURE_2D_ARRAY, isGrey ? greyAtlas : coloredAtlases[0]);
    }
    if (test.program === "table") sampler("u_table", 5, gl.TEXTURE_2D, colors);
    for (let i = 0; i < 8; i++) gl.disableVertexAttribArray(i);
    const attribute = (name, count, values, kind) => {
      const at = gl.getAttribLocation(used, name);
      if (at < 0) return;
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, count, kind, false, 0, 0);
    };
    attribute("a_position", 3, new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]), gl.FLOAT);
    attribute("a_normal", 3, new Float32Array([0, 1, 2].flatMap(() => test.normal)), gl.FLOAT);
    attribute("a_texcoord", 2, new Float32Array(test.attributes[0]), gl.FLOAT);
    test.attributes.forEach((codes, i) =>
      attribute(i ? `a_lightuv_${i}` : "a_lightuv", 2, new Uint16Array(codes), gl.UNSIGNED_SHORT));
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const drawn = new Float32Array(pixels * pixels * 4);
    gl.readPixels(0, 0, pixels, pixels, gl.RGBA, gl.FLOAT, drawn);
    const white = test.scale[2];
    const name = `${test.program} ${white ? "log" : "linear"}`;
    largest[name] ??= 0;
    test.expected.forEach((expected, i) => {
      const difference = Math.abs(drawn[4 * Math.floor(i / 3) + (i % 3)] - expected);
      const share = white ? difference / (Math.abs(expected) + white / 15) : difference;
      if (!(share <= largest[name])) largest[name] = share;
    });
  }
  if (gl.getError()) throw Error("a GL error");
  return JSON.stringify(largest, null, 1);
}

try {
  document.getElementById("result").textContent = run();
} catch (error) {
  document.getElementById("result").textContent = `failed: ${error}`;
}
