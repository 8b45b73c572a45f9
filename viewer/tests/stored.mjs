// What a viewer shows of stored light, against the decoder: one comparison for all engines.

import assert from 'node:assert/strict'
import { VIEWS, cameraFor, compare, visible } from './raster.mjs'
import { readScene } from './scene.mjs'

/** One step of 8 bits. */
export const STEP = 1 / 255

/**
 * Every layer of a file is what the decoder says, in all pixels that a rasterizer is certain of.
 *
 * - `t`: the test, which is told how far they are off
 * - `viewer`: `load(bytes, options)`, `view(signal)`, `pixels(camera)`, and `quiet()`, which finds complaints
 * - `shown`: the same light in another form; `views`: from where
 */
export async function assertStoredLight(t, viewer, file, { name, shown = file, views = VIEWS }) {
  const scene = await readScene(file)
  const roles = Object.fromEntries(scene.layers.map(({ signal }) => [signal, 'value']))
  assert.ok((await viewer.load(shown, { roles })).lit)
  let [worst, total] = [0, 0]
  for (const toward of views) {
    const camera = cameraFor(scene.triangles, toward)
    const clear = visible(scene.triangles, camera)
    for (const layer of scene.layers) {
      await viewer.view(layer.signal)
      const { largest, over, compared } = compare(clear, layer, await viewer.pixels(camera), STEP)
      assert.ok(compared > 1000, `only ${compared} pixels to compare`)
      assert.equal(over, 0, `${layer.signal}: ${over} of ${compared} pixels are off, by up to ${largest}`)
      worst = Math.max(worst, largest)
      total += compared
    }
  }
  t.diagnostic(`${name}: ${total} pixels of ${scene.layers.length} layers, off by ${worst.toFixed(5)} at most`)
  viewer.quiet()
}
