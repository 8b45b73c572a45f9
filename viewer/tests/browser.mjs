// A headless browser that sees this folder and the files of a test, and nothing else.

import { existsSync } from 'node:fs'
import { readFile } from 'node:fs/promises'
import { createServer } from 'node:http'
import { extname, join, normalize } from 'node:path'
import { fileURLToPath } from 'node:url'
import { chromium } from 'playwright-core'

const VIEWER = fileURLToPath(new URL('..', import.meta.url))
const TYPES = { '.html': 'text/html', '.js': 'text/javascript', '.mjs': 'text/javascript', '.cjs': 'text/javascript', '.wasm': 'application/wasm',
  '.json': 'application/json', '.png': 'image/png' }

// What Chromium remarks of the tests themselves, when a machine is slow enough: they read pixels back, which the pages of users do not.
const OUR_READING = /GL Driver Message \(OpenGL, Performance, .*GPU stall due to ReadPixels/

/** Debian's Chromium, or the one of `CHROMIUM`, or that of `npx playwright-core install chromium`. */
function executable() {
  const known = [process.env.CHROMIUM, '/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome']
  return known.find((path) => path && existsSync(path))
}

/** Chromium on a software renderer. */
export function launch(flags = []) {
  const args = ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', ...flags]
  return chromium.launch({ executablePath: executable(), args })
}

/** What a page complains about from now on: errors and warnings of its console, and what it does not catch. */
export function complaintsOf(page) {
  const complaints = []
  page.on('console', (message) => {
    if (['error', 'warning'].includes(message.type()) && !OUR_READING.test(message.text())) complaints.push(message.text())
  })
  page.on('pageerror', (error) => complaints.push(String(error)))
  return complaints
}

/**
 * - `root`: the folder that is served; that of the viewer unless told otherwise
 * - returns: `open(page)`, `files` (a Map of names to bytes, served under /files/), `close`, and playwright's `browser`
 */
export async function startBrowser({ root = VIEWER, flags = [] } = {}) {
  const files = new Map()
  const server = createServer(async (request, response) => {
    const path = normalize(decodeURIComponent(new URL(request.url, 'http://local').pathname))
    const file = path.startsWith('/files/') ? files.get(path.slice(7)) : await readFile(join(root, path)).catch(() => undefined)
    if (file === undefined) return response.writeHead(404).end()
    response.writeHead(200, { 'content-type': TYPES[extname(path)] ?? 'application/octet-stream' }).end(file)
  })
  await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve))
  const origin = `http://127.0.0.1:${server.address().port}`
  const browser = await launch(flags)

  /**
   * A page of this server, or of another one by its whole address, once it says that it is `ready`; with everything that it
   * complained about in `complaints`.
   */
  async function open(path, viewport = { width: 256, height: 256 }, ready = () => globalThis.ready === true) {
    const page = await browser.newPage({ viewport })
    // Engines are hundreds of modules, and machines may be busy.
    page.setDefaultTimeout(180_000)
    const complaints = complaintsOf(page)
    page.on('response', (response) => response.status() >= 400 && complaints.push(`${response.status()} ${response.url()}`))
    await page.goto(new URL(path, origin).href)
    await page.waitForFunction(ready)
    return { page, complaints }
  }

  async function close() {
    await browser.close()
    server.closeAllConnections()
    await new Promise((resolve) => server.close(resolve))
  }
  return { files, open, close, browser }
}

/** Numbers that a page gave as base64 of 32-bit floats. */
export function floats(base64) {
  const { buffer, byteOffset, byteLength } = Buffer.from(base64, 'base64')
  return new Float32Array(buffer.slice(byteOffset, byteOffset + byteLength))
}
