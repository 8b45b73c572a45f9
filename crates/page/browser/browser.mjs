// What the tests of the page share: the program, and the headless browser of viewer/.

import { spawn } from 'node:child_process'
import { join } from 'node:path'
import { fileURLToPath } from 'node:url'

import { launch as chromium } from '../../../viewer/tests/browser.mjs'

export { complaintsOf } from '../../../viewer/tests/browser.mjs'

export const ROOT = fileURLToPath(new URL('../../..', import.meta.url))
export const PROGRAM = process.env.LIGHTKILN ?? join(ROOT, 'target/release/lightkiln')

export const launch = () => chromium(['--hide-scrollbars'])

/** `lightkiln view` with these arguments: where it serves, and what ends it. */
export async function serve(args) {
  const server = spawn(PROGRAM, ['view', '--quiet', ...args])
  const url = await new Promise((resolve, reject) => {
    server.stdout.once('data', (data) => resolve(String(data).trim()))
    server.stderr.once('data', (data) => reject(new Error(String(data))))
  })
  return { url, stop: () => server.kill() }
}

/**
 * RGBA of what the page of `view` shows, from the bottom, painted anew with some of its state changed.
 */
export async function pixelsOf(page, changes = {}) {
  const base64 = await page.evaluate((changes) => {
    const { state, renderer, paint } = globalThis.lightkiln
    Object.assign(state, changes)
    paint()
    const { gl, canvas } = renderer
    const pixels = new Uint8Array(4 * canvas.width * canvas.height)
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels)
    let text = ''
    for (let i = 0; i < pixels.length; i += 32768) text += String.fromCharCode(...pixels.subarray(i, i + 32768))
    return btoa(text)
  }, changes)
  return Buffer.from(base64, 'base64')
}
