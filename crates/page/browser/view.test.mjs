// `lightkiln view` in a headless browser: what it shows against the program's own pictures, and that all of it works.
// LIGHTKILN names the program. Real scenes are opened by viewer/scenes/open.test.mjs.

import assert from 'node:assert/strict'
import { execFileSync } from 'node:child_process'
import { existsSync, mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from 'node:fs'
import { createServer, request } from 'node:http'
import { tmpdir } from 'node:os'
import { dirname, join } from 'node:path'
import { after, before, test } from 'node:test'
import { gunzipSync } from 'node:zlib'

import { PROGRAM, ROOT, complaintsOf, launch, pixelsOf, serve } from './browser.mjs'

const run = (...args) => execFileSync(PROGRAM, args, { encoding: 'utf8', stdio: ['ignore', 'pipe', 'pipe'] })
const folder = mkdtempSync(join(tmpdir(), 'lightkiln-view-'))
const file = (name) => join(folder, name)

let browser
before(async () => (browser = await launch()))
after(async () => {
  await browser?.close()
  rmSync(folder, { recursive: true })
})

function bake(scene, name, ...extra) {
  try {
    run('bake', scene, '-o', file(name), '--quality', 'draft', '--quiet', '--report', file(`${name}.json`), ...extra)
  } catch (error) {
    // A bound that a draft does not keep is no fault of the page.
    if (error.status !== 6) throw error
  }
  return file(name)
}

/** Serves a file, opens the page, and ends both when `use` is done. The page must have complained about nothing. */
async function view(args, use, context = {}) {
  const { url, stop } = await serve(args)
  const page = await browser.newPage({ viewport: { width: 512, height: 512 }, ...context })
  const complaints = complaintsOf(page)
  page.on('request', (asked) => asked.url().startsWith(url) || asked.url().startsWith('data:') || complaints.push(asked.url()))
  try {
    await page.goto(url)
    await page.waitForFunction(() => globalThis.ready === true)
    await use(page, url)
    assert.deepEqual(complaints, [])
  } finally {
    await page.close()
    stop()
  }
}

/** The light as bytes, from the top, with some of the state changed; colors of materials and the atlas are off. */
const shot = async (page, changes) => {
  const width = await page.evaluate(() => {
    document.getElementById('show-atlas').checked = false
    return globalThis.lightkiln.renderer.canvas.width
  })
  const pixels = await pixelsOf(page, { materials: false, ...changes })
  const rows = Array.from({ length: pixels.length / width / 4 }, (_, row) => pixels.subarray(4 * row * width, 4 * (row + 1) * width))
  return Buffer.concat(rows.reverse())
}

/** A picture file as bytes. */
const decoded = (page, png) =>
  page.evaluate(async (data) => {
    const image = new Image()
    image.src = `data:image/png;base64,${data}`
    await image.decode()
    const canvas = Object.assign(document.createElement('canvas'), { width: image.width, height: image.height })
    const context = canvas.getContext('2d')
    context.drawImage(image, 0, 0)
    return [...context.getImageData(0, 0, image.width, image.height).data]
  }, readFileSync(png).toString('base64'))

function difference(a, b) {
  assert.equal(a.length, b.length)
  let square = 0
  let large = 0
  for (let i = 0; i < a.length; i++) {
    if (i % 4 === 3) continue
    square += (a[i] - b[i]) ** 2
    if (Math.abs(a[i] - b[i]) > 8) large++
  }
  const count = (a.length / 4) * 3
  return { rmse: Math.sqrt(square / count) / 255, large: large / count }
}

test('the page shows what the program renders, layer by layer', async (t) => {
  const baked = bake(join(ROOT, 'data/cornell.glb'), 'cornell.glb', '--signal', 'ao+irradiance')
  await view([baked], async (page) => {
    for (const layer of [0, 1]) {
      run('render', baked, '-o', file('cpu.png'), '--mode', 'light', '--size', '512', '--layer', String(layer), '--quiet')
      const shown = await shot(page, { left: 'hybrid', divider: 1, layer })
      const { rmse, large } = difference(shown, await decoded(page, file('cpu.png')))
      t.diagnostic(`layer ${layer}: RMSE ${rmse.toFixed(4)}, ${(100 * large).toFixed(2)} % differ by more than 8 of 255`)
      // Edges are smoothed by other places within a pixel; surfaces agree.
      assert.ok(rmse < 0.015 && large < 0.01, `layer ${layer}: RMSE ${rmse}, ${large} of the pixels differ`)
    }
    run('render', baked, '-o', file('cpu.png'), '--mode', 'classes', '--size', '512', '--quiet')
    const shown = await shot(page, { overlay: 'classes' })
    const { rmse, large } = difference(shown, await decoded(page, file('cpu.png')))
    assert.ok(rmse < 0.02 && large < 0.02, `classes: RMSE ${rmse}, ${large} of the pixels differ`)
  })
})

test('a table of colors shows what packed codes show', async () => {
  const scene = join(ROOT, 'data/cornell.glb')
  const baked = bake(scene, 'table.glb', '--signal', 'irradiance', '--table')
  await view([baked], async (page) => {
    run('render', baked, '-o', file('cpu.png'), '--mode', 'light', '--size', '512', '--quiet')
    const { rmse } = difference(await shot(page, { left: 'hybrid', divider: 1 }), await decoded(page, file('cpu.png')))
    assert.ok(rmse < 0.015, `RMSE ${rmse}`)
  })
})

test('light that is clamped after interpolation looks so', async () => {
  const baked = bake(join(ROOT, 'data/cornell_box.glb'), 'clamp.glb', '--bounds', 'clamp-after')
  await view([baked], async (page) => {
    assert.deepEqual(await page.evaluate(() => globalThis.lightkiln.model.about.layers[0].clamp), [0, 1])
    run('render', baked, '-o', file('cpu.png'), '--mode', 'light', '--size', '512', '--quiet')
    const { rmse } = difference(await shot(page, { left: 'hybrid', divider: 1 }), await decoded(page, file('cpu.png')))
    assert.ok(rmse < 0.015, `RMSE ${rmse}`)
  })
})

test('harmonics at the normal show the irradiance', async (t) => {
  for (const order of [1, 2]) {
    const baked = bake(join(ROOT, 'data/cornell.glb'), `sh${order}.glb`, '--signal', `irradiance+sh${order}`)
    await view([baked], async (page) => {
      const plain = await shot(page, { left: 'hybrid', divider: 1, layer: 0 })
      const white = await page.evaluate(() => {
        const { model, setLayer } = globalThis.lightkiln
        setLayer('harmonics')
        return [0, model.harmonics[0]].map((layer) => model.about.layers[layer].white)
      })
      // Both are exposed for a white of their own; that of coefficients is of the first, E / 0.282095.
      const exposure = Math.log2((0.282095 * white[1]) / white[0])
      const { rmse } = difference(plain, await shot(page, { left: 'hybrid', divider: 1, exposure }))
      t.diagnostic(`order ${order}: RMSE ${rmse.toFixed(4)}`)
      assert.ok(rmse < (order === 1 ? 0.12 : 0.06), `order ${order}: RMSE ${rmse}`)
    })
  }
})

test('every way of showing and every overlay is a picture of its own', async () => {
  const baked = bake(join(ROOT, 'data/cornell_box.glb'), 'box.glb')
  await view([baked, '--trace', '20000', '--report', `${baked}.json`], async (page) => {
    const pictures = []
    for (const left of ['hybrid', 'vertices', 'full', 'fallback', 'none']) pictures.push([left, await shot(page, { left, divider: 1, overlay: 'none' })])
    for (const overlay of ['classes', 'charts', 'density', 'error']) pictures.push([overlay, await shot(page, { left: 'hybrid', overlay })])
    pictures.push(['wireframe', await shot(page, { overlay: 'none', wireframe: true })])
    for (const [name, pixels] of pictures) {
      const dark = pixels.filter((v, i) => i % 4 === 0 && v < 8).length
      assert.ok(dark < pixels.length / 8, `${name} is black`)
      for (const [other, others] of pictures) {
        if (other !== name) assert.ok(difference(pixels, others).rmse > 0.001, `${name} is ${other}`)
      }
    }
    // Left and right of the divider are what the two are alone.
    const [hybrid, none] = ['hybrid', 'none'].map((name) => pictures.find(([other]) => other === name)[1])
    const both = await shot(page, { left: 'hybrid', right: 'none', divider: 0.5, wireframe: false })
    const mixed = both.filter((v, i) => v !== ((i / 4) % 512 < 256 ? hybrid : none)[i]).length
    assert.ok(mixed < both.length * 1e-3, `${mixed} bytes differ`)
    // A lightmap over everything is the same light.
    const full = pictures.find(([name]) => name === 'full')[1]
    assert.ok(difference(full, hybrid).rmse < 0.03, `the full lightmap is ${difference(full, hybrid).rmse} off`)
    assert.match(await page.locator('#figures').textContent(), /light on the GPU[\d.]+ [kM]?i?B.*RMSE/)
  })
})

test('pointing at the scene finds the texel, and pointing at the texel finds the triangle', async () => {
  const baked = bake(join(ROOT, 'data/cornell_box.glb'), 'hover.glb')
  await view([baked], async (page) => {
    // The middle of each texture triangle that is seen, in the scene and in the atlas.
    const places = await page.evaluate(() => {
      const { state, model, renderer } = globalThis.lightkiln
      const { width, height } = renderer.canvas.getBoundingClientRect()
      const matrix = state.camera.clipFromWorld(width, height)
      const found = []
      for (let triangle = 0; triangle < model.indices.length / 3; triangle++) {
        if (model.kind(triangle) !== 'texture') continue
        const corners = [...model.corners(triangle)]
        const middle = [0, 1, 2].map((k) => corners.reduce((sum, v) => sum + model.position(v)[k] / 3, 0)).concat(1)
        const clip = [0, 1, 2, 3].map((row) => middle.reduce((sum, v, k) => sum + matrix[4 * k + row] * v, 0))
        const scene = [((1 + clip[0] / clip[3]) / 2) * width, ((1 - clip[1] / clip[3]) / 2) * height]
        const place = [0, 1].map((k) => corners.reduce((sum, v) => sum + model.place(v)[k] / 3, 0))
        const { box, middle: from, zoom } = state.atlas
        const atlas = [(box.left + box.right) / 2 + (place[0] - from[0]) * zoom, (box.top + box.bottom) / 2 + (place[1] - from[1]) * zoom]
        found.push({ triangle, scene, atlas, inScene: renderer.pick(state, ...scene, false)?.triangle, inAtlas: renderer.pick(state, ...atlas, true)?.triangle, place })
      }
      return found
    })
    assert.ok(places.length > 20)
    for (const { triangle, inAtlas } of places) assert.equal(inAtlas, triangle)
    const seen = places.filter(({ triangle, inScene }) => inScene === triangle)
    assert.ok(seen.length > places.length / 4, `${seen.length} of ${places.length} are seen`)
    const { triangle, atlas, place } = places[0]
    await page.mouse.move(...atlas)
    await page.waitForFunction(() => document.getElementById('hover').textContent !== '')
    const text = await page.locator('#hover').textContent()
    assert.match(text, new RegExp(`triangle ${triangle}, texture, texel `))
    const texel = text.match(/texel (\d+), (\d+)/).slice(1).map(Number)
    texel.forEach((t, k) => assert.ok(Math.abs(t + 0.5 - place[k]) < 1.5, `${text}, but ${place}`))
  })
})

test('surfaces have the colors of their textures, times the light', async (t) => {
  execFileSync(join(dirname(PROGRAM), 'lightkiln-props'), ['picture', '-o', file('picture.in.glb')])
  const baked = bake(file('picture.in.glb'), 'picture.glb', '--samples', '20000')
  await view([baked], async (page) => {
    await page.waitForFunction(() => {
      const { pictures, white } = globalThis.lightkiln.renderer
      return pictures.size > 0 && [...pictures.values()].every(({ texture }) => texture !== white)
    })
    const [light, shown] = [await shot(page, { left: 'hybrid', divider: 1 }), await shot(page, { materials: true })]
    // Texels under a grid of pixels, looked up as glTF says, nearest.
    const albedo = await page.evaluate(async () => {
      const { state, model, renderer } = globalThis.lightkiln
      const { image } = model.about.textures[0]
      const bitmap = await createImageBitmap(await (await fetch(image)).blob(), { colorSpaceConversion: 'none' })
      const canvas = Object.assign(document.createElement('canvas'), { width: bitmap.width, height: bitmap.height })
      const context = canvas.getContext('2d', { willReadFrequently: true })
      context.drawImage(bitmap, 0, 0)
      const uvs = model.numbers('uvs', Float32Array)
      const found = []
      for (let y = 4; y < 512; y += 8) {
        for (let x = 4; x < 512; x += 8) {
          const hit = renderer.pick(state, x + 0.5, y + 0.5, false)
          if (!hit) continue
          const corners = [...model.corners(hit.triangle)]
          const at = [0, 1].map((k) => corners.reduce((sum, v, c) => sum + hit.weights[c] * uvs[2 * v + k], 0))
          const texel = [bitmap.width, bitmap.height].map((size, k) => Math.min(size - 1, Math.floor((at[k] - Math.floor(at[k])) * size)))
          found.push({ pixel: 512 * y + x, rgb: [...context.getImageData(...texel, 1, 1).data].slice(0, 3) })
        }
      }
      return found
    })
    assert.ok(albedo.length > 500, `${albedo.length} pixels`)
    const linear = (byte) => (byte / 255 <= 0.04045 ? byte / 255 / 12.92 : ((byte / 255 + 0.055) / 1.055) ** 2.4)
    const errors = albedo.flatMap(({ pixel, rgb }) => rgb.map((value, c) => Math.abs(linear(shown[4 * pixel + c]) - linear(value) * linear(light[4 * pixel + c]))))
    errors.sort((a, b) => a - b)
    const [median, most] = [errors[errors.length >> 1], errors[Math.floor(0.9 * errors.length)]]
    t.diagnostic(`${albedo.length} pixels: median ${median.toFixed(4)}, nine of ten below ${most.toFixed(4)}`)
    // Texels between two are mixed in the page.
    assert.ok(median < 0.02, `median ${median}`)
  })
})

test('keys and touch do what the list of keys says', async () => {
  const baked = bake(join(ROOT, 'data/column.glb'), 'column.glb')
  const state = (page) => page.evaluate(() => {
    const { camera, divider, left, right, overlay, materials, wireframe } = globalThis.lightkiln.state
    return { azimuth: camera.azimuth, elevation: camera.elevation, distance: camera.distance, target: camera.target, divider, left, right, overlay, materials, wireframe }
  })
  await view([baked], async (page) => {
    const start = await state(page)
    for (const key of ['ArrowLeft', 'ArrowUp', '+', ']', 'x', '3', 'm', 'w', 'Shift+ArrowRight']) await page.keyboard.press(key)
    const now = await state(page)
    assert.ok(now.azimuth !== start.azimuth && now.elevation > start.elevation && now.distance < start.distance)
    assert.notDeepEqual(now.target, start.target)
    assert.deepEqual([now.left, now.right], [start.right, start.left])
    assert.deepEqual([now.overlay, now.materials, now.wireframe, now.divider], ['density', false, true, 0.55])
    await page.keyboard.press('r')
    assert.equal((await state(page)).azimuth, start.azimuth)
    await page.keyboard.press('?')
    assert.ok(await page.locator('#keys').isVisible())
  })
  const phone = { viewport: { width: 390, height: 780 }, hasTouch: true, isMobile: true, colorScheme: 'dark' }
  await view([baked], async (page) => {
    const start = await state(page)
    await page.touchscreen.tap(150, 430)
    await page.waitForFunction(() => document.getElementById('hover').textContent !== '')
    const client = await page.context().newCDPSession(page)
    const touch = (type, ...points) => client.send('Input.dispatchTouchEvent', { type, touchPoints: points.map(([x, y], id) => ({ x, y, id })) })
    await touch('touchStart', [60, 300], [150, 300])
    await touch('touchMove', [20, 300], [165, 300])
    await touch('touchEnd')
    assert.ok((await state(page)).distance < start.distance * 0.8, 'a pinch comes closer')
    const width = await page.evaluate(() => document.documentElement.scrollWidth)
    assert.equal(width, 390)
  }, phone)
})

test('on a phone the divider, the names, the legend and the atlas keep clear of each other', async () => {
  const baked = bake(join(ROOT, 'data/column.glb'), 'phone.glb')
  for (const [width, height] of [[390, 844], [844, 390]]) {
    await view([baked], async (page) => {
      for (const overlay of ['none', 'classes', 'error']) {
        const boxes = await page.evaluate(async (overlay) => {
          globalThis.lightkiln.set({ overlay })
          await new Promise((done) => requestAnimationFrame(done))
          const shown = ['#divider', '#divider span', '#left-name', '#right-name', '#legend', '#atlas', '#panel'].map((name) => [name, document.querySelector(name)])
          const visible = shown.filter(([, box]) => getComputedStyle(box).display !== 'none')
          return visible.map(([name, box]) => {
            const { left, right, top, bottom } = box.getBoundingClientRect()
            return { name, left, right, top, bottom }
          })
        }, overlay)
        assert.ok(['#divider', '#atlas'].every((name) => boxes.some((box) => box.name === name)))
        for (const [i, a] of boxes.entries()) {
          for (const b of boxes.slice(i + 1)) {
            // The grip is on the line, and the head of the panel is wide.
            if (a.name === '#divider' && (b.name === '#divider span' || b.name === '#panel')) continue
            const apart = a.right <= b.left || b.right <= a.left || a.bottom <= b.top || b.bottom <= a.top
            assert.ok(apart, `${width} x ${height}, ${overlay}: ${a.name} is over ${b.name}`)
          }
        }
      }
    }, { viewport: { width, height }, hasTouch: true, isMobile: true })
  }
})

/** A GLB with its JSON changed. */
function changed(from, to, change) {
  const glb = readFileSync(from)
  const length = glb.readUInt32LE(12)
  const json = JSON.parse(glb.subarray(20, 20 + length))
  change(json)
  let text = JSON.stringify(json)
  text = Buffer.from(text.padEnd(text.length + ((4 - (Buffer.byteLength(text) % 4)) % 4)))
  const [head, rest] = [Buffer.alloc(20), glb.subarray(20 + length)]
  glb.copy(head, 0, 0, 20)
  head.writeUInt32LE(20 + text.length + rest.length, 8)
  head.writeUInt32LE(text.length, 12)
  writeFileSync(to, Buffer.concat([head, text, rest]))
  return to
}

test('a part that went astray does not make the scene small, and is drawn all the same', async () => {
  const scene = join(ROOT, 'data/column.glb')
  const astray = changed(scene, file('astray.in.glb'), ({ nodes, scenes, scene = 0 }) => {
    const mesh = nodes.find((node) => node.mesh !== undefined).mesh
    scenes[scene].nodes.push(nodes.push({ name: 'astray', mesh, scale: [0.01, 0.01, 0.01], translation: [500, 0, 0] }) - 1)
  })
  const cameras = []
  for (const [input, name] of [[scene, 'whole.glb'], [astray, 'astray.glb']]) {
    await view([bake(input, name, '--samples', '4000')], async (page) => {
      cameras.push(await page.evaluate(() => {
        const { state: { camera }, model: { about } } = globalThis.lightkiln
        return { distance: camera.distance, target: camera.target, frame: about.frame, right: about.bounds[1][0] }
      }))
    })
  }
  const [whole, stray] = cameras
  assert.deepEqual([stray.distance, stray.target, stray.frame], [whole.distance, whole.target, whole.frame])
  assert.ok(stray.right > 499 && whole.right < 100)
  // The program's own pictures are of the same place, but for rounding: rays know how large the whole scene is.
  for (const name of ['whole', 'astray']) run('render', file(`${name}.glb`), '-o', file(`${name}.png`), '--mode', 'clay', '--size', '128', '--quiet')
  const page = await browser.newPage()
  const { rmse } = difference(await decoded(page, file('whole.png')), await decoded(page, file('astray.png')))
  await page.close()
  assert.ok(rmse < 0.002, `RMSE ${rmse}`)
})

/** A folder as any server has it. */
async function staticServer(folder) {
  const kinds = { html: 'text/html', js: 'text/javascript', css: 'text/css', json: 'application/json' }
  const server = createServer(({ url }, answer) => {
    const name = url === '/' ? 'index.html' : url.slice(1)
    if (!existsSync(join(folder, name))) return answer.writeHead(404).end()
    answer.writeHead(200, { 'content-type': kinds[name.split('.').pop()] ?? 'application/octet-stream' }).end(readFileSync(join(folder, name)))
  })
  await new Promise((listening) => server.listen(0, '127.0.0.1', listening))
  return { url: `http://127.0.0.1:${server.address().port}/`, stop: () => server.close() }
}

test('an export shows the same from any web server', async () => {
  const baked = bake(join(ROOT, 'data/column.glb'), 'export.glb')
  run('view', baked, '--export', file('exported'), '--quiet')
  const light = { left: 'hybrid', divider: 1 }
  let served
  await view([baked], async (page) => (served = await shot(page, light)))
  const { url, stop } = await staticServer(file('exported'))
  const page = await browser.newPage({ viewport: { width: 512, height: 512 } })
  const complaints = complaintsOf(page)
  await page.goto(url)
  await page.waitForFunction(() => globalThis.ready === true)
  assert.ok(served.equals(await shot(page, light)))
  assert.deepEqual(complaints, [])
  await page.close()
  stop()
})

test('the server answers this machine alone, and an export is the same site', async () => {
  const baked = bake(join(ROOT, 'data/contact.glb'), 'contact.glb')
  run('view', baked, '--export', file('site'), '--quiet')
  await view([baked], async (page, url) => {
    const { port } = new URL(url)
    const ask = (path, headers = {}) => new Promise((resolve) => {
      request({ host: '127.0.0.1', port, path, headers, agent: false }, (answer) => {
        const chunks = []
        answer.on('data', (chunk) => chunks.push(chunk)).on('end', () => resolve([answer.statusCode, Buffer.concat(chunks)]))
      }).end()
    })
    assert.equal((await ask('/', { host: 'evil.example' }))[0], 403)
    assert.equal((await ask('/../Cargo.toml'))[0], 404)
    for (const name of readdirSync(file('site'))) {
      const [status, bytes] = await ask(`/${name}`)
      assert.equal(status, 200)
      const exported = readFileSync(join(file('site'), name))
      if (name !== 'mode.js') assert.ok(bytes.equals(name.endsWith('.bin') ? gunzipSync(exported) : exported), name)
    }
  })
})

test('the report is a page of less than 2 MB that shows itself in light, dark and on paper', async () => {
  run('bake', join(ROOT, 'data/cornell_box.glb'), '-o', file('report.glb'), '--quality', 'draft', '--quiet', '--report', file('report.html'))
  const html = readFileSync(file('report.html'))
  assert.ok(html.length < 2e6, `${html.length} bytes`)
  for (const colorScheme of ['light', 'dark']) {
    const context = await browser.newContext({ colorScheme, javaScriptEnabled: false, offline: true, viewport: { width: 390, height: 800 } })
    const page = await context.newPage()
    const complaints = []
    page.on('console', (message) => complaints.push(message.text()))
    page.on('request', (asked) => asked.url().startsWith('http') && complaints.push(asked.url()))
    await page.goto(`file://${file('report.html')}`)
    assert.equal(await page.locator('figure img').count(), 5)
    const boxes = await Promise.all((await page.locator('figure img').all()).map((image) => image.boundingBox()))
    assert.ok(boxes.every(({ width, height }) => width > 100 && height > 100), 'pictures decode')
    assert.ok(complaints.length === 0, complaints.join('\n'))
    const pdf = await page.pdf({ format: 'A4' })
    assert.ok(pdf.length > 20_000)
    await context.close()
  }
})
