// "Five minutes with three.js" of ../README.md, as a stranger would follow it: the README's own commands and page, in an
// empty folder.

import assert from 'node:assert/strict'
import { execFile } from 'node:child_process'
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs'
import { tmpdir } from 'node:os'
import { join } from 'node:path'
import { after, test } from 'node:test'
import { fileURLToPath } from 'node:url'
import { promisify } from 'node:util'
import { readImage } from 'lightkiln-format'
import { baked } from './baked.mjs'
import { startBrowser } from './browser.mjs'

const README = readFileSync(new URL('../README.md', import.meta.url), 'utf8')
const ROOT = fileURLToPath(new URL('../..', import.meta.url)).replace(/\/$/, '')
const VIEWPORT = { width: 640, height: 480 }
const SHOW = 'scene.add(gltf.scene)'

/** Blocks of a language, without what they are indented by. */
const blocks = (language) =>
  [...README.matchAll(new RegExp(`^( *)\`\`\`${language}\\n([^]*?)^\\1\`\`\``, 'gm'))]
    .map(([, indent, text]) => text.replaceAll(new RegExp(`^${indent}`, 'gm'), ''))

const folder = mkdtempSync(join(tmpdir(), 'lightkiln-stranger-'))
after(() => rmSync(folder, { recursive: true }))

/** Screen colors of the page, once it shows something. */
async function picture(browser) {
  const { page, complaints } = await browser.open('/index.html', VIEWPORT, () => document.querySelector('canvas') !== null)
  const deadline = Date.now() + 60_000
  for (;;) {
    await page.waitForTimeout(500)
    const { data } = await readImage(new Uint8Array(await page.screenshot({ type: 'png' })))
    const colors = new Set(data)
    if (colors.size > 8) {
      await page.close()
      return { data, complaints }
    }
    assert.ok(Date.now() < deadline, `the page stays empty: ${complaints.join('; ')}`)
  }
}

test('the commands and the page of the README show light in three.js', async () => {
  const [install] = blocks('sh').filter((block) => block.includes('npm pack'))
  const [html] = blocks('html')
  const commands = install.replaceAll('/path/to/lightkiln', ROOT)
  await promisify(execFile)('sh', ['-ec', commands], { cwd: folder, timeout: 240_000 })
  const name = html.match(/loadAsync\('(.*)'\)/)[1]
  writeFileSync(join(folder, name), baked('contact'))
  writeFileSync(join(folder, 'index.html'), html)
  const browser = await startBrowser({ root: folder })
  try {
    const shown = await picture(browser)
    assert.deepEqual(shown.complaints, [])
    // The same page with the occlusion turned off is brighter where things are near each other.
    assert.ok(html.includes(SHOW))
    writeFileSync(join(folder, 'index.html'), html.replace(SHOW, `${SHOW}\ngltf.userData.lightkiln.occlusionIntensity = 0`))
    const bright = await picture(browser)
    assert.deepEqual(bright.complaints, [])
    const darker = shown.data.filter((value, i) => value < bright.data[i] - 8).length
    const lighter = shown.data.filter((value, i) => value > bright.data[i] + 8).length
    assert.ok(darker > shown.data.length / 100 && lighter === 0, `${darker} of ${shown.data.length} numbers are darker, ${lighter} lighter`)
  } finally {
    await browser.close()
  }
})
