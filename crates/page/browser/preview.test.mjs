// `lightkiln bake --preview` in a headless browser: the page shows the bake before it ends, ends as the page of the file, and
// stops it.

import assert from 'node:assert/strict'
import { execFileSync, spawn } from 'node:child_process'
import { mkdtempSync, readFileSync, readdirSync, rmSync } from 'node:fs'
import { tmpdir } from 'node:os'
import { join } from 'node:path'
import { after, before, test } from 'node:test'

import { PROGRAM, ROOT, complaintsOf, launch } from './browser.mjs'

const folder = mkdtempSync(join(tmpdir(), 'lightkiln-preview-'))
const file = (name) => join(folder, name)

let browser
before(async () => (browser = await launch()))
after(async () => {
  await browser?.close()
  rmSync(folder, { recursive: true })
})

/** Starts a bake with its page open; what the page complains of is gathered. */
async function preview(scene, name, ...args) {
  const bake = spawn(PROGRAM, ['bake', scene, '-o', file(name), '--quiet', '--preview', ...args])
  let said = ''
  bake.stderr.on('data', (data) => (said += data))
  const ended = new Promise((resolve) => bake.on('exit', (code) => resolve(code)))
  while (!said.includes('\n')) await new Promise((resolve) => bake.stderr.once('data', resolve))
  const url = said.match(/http:\S+/)[0]
  return { ...(await opened(url)), url, ended, said: () => said }
}

/**
 * A page, and what it complains of.
 * - `hold`: what its wish for a block of light waits for, given the version; none: nothing
 */
async function opened(url, hold) {
  const page = await browser.newPage({ viewport: { width: 1100, height: 700 } })
  const complaints = complaintsOf(page)
  if (hold) {
    await page.route(/light-\d+\.bin$/, async (route) => {
      await hold(Number(route.request().url().match(/\d+(?=\.bin)/)[0]))
      await route.continue()
    })
  }
  await page.goto(url)
  return { page, complaints }
}

const phase = (page) => page.locator('#bake').getAttribute('data-phase')

/** How many grays there are in the scene as it is shown now. */
const grays = (page) =>
  page.evaluate(() => {
    const { renderer, paint } = globalThis.lightkiln
    paint()
    const { gl, canvas } = renderer
    const pixels = new Uint8Array(4 * canvas.width * canvas.height)
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels)
    return new Set(pixels.filter((_, i) => i % 4 === 0)).size
  })

test('the page shows a bake before its end, refines it, and ends as the page of the file', async (t) => {
  const { page, complaints, ended } = await preview(join(ROOT, 'data/cornell.glb'), 'watched.glb', '--quality', 'normal', '--samples', '60000')
  // Something is there while the bake goes on: light at vertices, and no atlas yet.
  await page.waitForFunction(() => globalThis.lightkiln?.model.about.lit)
  const states = [await page.evaluate(() => ({ ...globalThis.lightkiln.model.about.classes, version: document.getElementById('bake').dataset.shown }))]
  assert.notEqual(await phase(page), 'done')
  assert.equal(states[0].texture, 0)
  assert.ok((await grays(page)) > 20)
  const turned = await page.evaluate(() => (globalThis.lightkiln.state.camera.azimuth = 0.2))
  await page.waitForFunction(() => document.getElementById('bake').dataset.phase === 'done', undefined, { timeout: 120_000 })
  await page.waitForFunction(() => globalThis.lightkiln.model.about.figures.lines)
  states.push(await page.evaluate(() => globalThis.lightkiln.model.about.classes))
  assert.ok(states[1].texture > 0)
  t.diagnostic(`${await page.locator('#bake').getAttribute('data-shown')} versions`)
  assert.match(await page.locator('#figures').textContent(), /light on the GPU.*RMSE/)
  assert.equal(await page.evaluate(() => globalThis.lightkiln.state.camera.azimuth), turned)
  // The model is that of `view`, but for the figures, which come from the report.
  execFileSync(PROGRAM, ['view', file('watched.glb'), '--export', file('site'), '--quiet'])
  const expected = JSON.parse(readFileSync(file('site/model.json')))
  const shown = await page.evaluate(() => globalThis.lightkiln.model.about)
  for (const about of [expected, shown]) delete about.figures, delete about.blocks
  assert.deepEqual(shown, expected)
  assert.deepEqual(complaints, [])
  await page.close()
  assert.equal(await ended, 0)
  // Watching changes nothing.
  execFileSync(PROGRAM, ['bake', join(ROOT, 'data/cornell.glb'), '-o', file('plain.glb'), '--quality', 'normal', '--quiet', '--samples', '60000'])
  assert.ok(readFileSync(file('plain.glb')).equals(readFileSync(file('watched.glb'))))
})

test('a page that is slow to fetch light, beside one that is not, has the last of it in the end', async (t) => {
  const quick = await preview(join(ROOT, 'data/cornell.glb'), 'late.glb', '--quality', 'normal', '--samples', '60000')
  const isPast = (version) => {
    const { phase, shown } = document.getElementById('bake').dataset
    return phase === 'done' || Number(shown) >= version + 2
  }
  const slow = await opened(quick.url, (version) => quick.page.waitForFunction(isPast, version, { timeout: 120_000 }))
  let past = 0
  slow.page.on('response', (response) => (past += response.status() === 204))
  for (const { page } of [quick, slow]) {
    await page.waitForFunction(() => document.getElementById('bake').dataset.phase === 'done', undefined, { timeout: 120_000 })
    await page.waitForFunction(() => globalThis.lightkiln?.model.about.figures.lines)
  }
  t.diagnostic(`${past} blocks of light were past when the slow page asked for them`)
  assert.ok(past > 0)
  assert.deepEqual([quick.complaints, slow.complaints], [[], []])
  await Promise.all([quick, slow].map(({ page }) => page.close()))
  assert.equal(await quick.ended, 0)
})

test('the button of the page stops the bake, and the page says so', async () => {
  const { page, complaints, ended, said } = await preview(join(ROOT, 'data/cornell.glb'), 'never.glb', '--quality', 'final', '--samples', '200000', '--signal', 'lightmap')
  await page.waitForFunction(() => globalThis.ready)
  await page.locator('#bake button').click()
  await page.waitForFunction(() => document.getElementById('bake').dataset.phase === 'cancelled')
  assert.match(await page.locator('#bake').textContent(), /Cancelled: nothing was written/)
  assert.equal(await ended, 130)
  assert.match(said(), /the bake was cancelled, and nothing was written/)
  assert.deepEqual(readdirSync(folder).filter((name) => name.includes('never')), [])
  assert.deepEqual(complaints, [])
  await page.close()
})
