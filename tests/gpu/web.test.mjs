// The GLSL of shaders/ in a headless browser against the CPU twin: every program, within one step of 8 bits.
// Opens out/gpu_check.html, which `make test-gpu-web` makes.

import assert from 'node:assert/strict'
import { test } from 'node:test'
import { fileURLToPath } from 'node:url'
import { startBrowser } from '../../viewer/tests/browser.mjs'

const PROGRAMS = ['', ' plain'].flatMap((kind) => ['scalar', 'rgb', 'table', 'interop', 'clamped'].flatMap((name) =>
  [`${name}${kind} linear`, `${name}${kind} log`]).concat(`sh${kind} linear`))

test('WebGL 2 shows what the CPU twin says', async (t) => {
  const browser = await startBrowser({ root: fileURLToPath(new URL('../../out', import.meta.url)) })
  try {
    const { page, complaints } = await browser.open('/gpu_check.html')
    const { failure, result, renderer, bound } = await page.evaluate(() => ({ failure: globalThis.failure, result: globalThis.result, renderer: globalThis.renderer }))
    assert.equal(failure, undefined)
    t.diagnostic(renderer)
    assert.deepEqual(Object.keys(result).sort(), PROGRAMS.sort())
    for (const [name, { largest, compared }] of Object.entries(result)) {
      t.diagnostic(`${name}: off by ${largest.toExponential(1)} at most, of ${compared} numbers`)
      assert.ok(compared > 4000, `${name}: only ${compared} numbers`)
      assert.ok(largest <= 1 / 255, `${name}: off by ${largest}`)
    }
    assert.deepEqual(complaints, [])
  } finally {
    await browser.close()
  }
})
