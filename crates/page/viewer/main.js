// The page: what is chosen, keys and pointers, and when to draw.

import { Camera } from './camera.js'
import { legend } from './legend.js'
import { follow } from './live.js'
import { LIVE } from './mode.js'
import { load } from './model.js'
import { Renderer } from './renderer.js'

const SHOWN = { hybrid: 'as baked', vertices: 'vertices only', full: 'full lightmap', fallback: 'fallback (COLOR_0)', none: 'no light' }
const OVERLAYS = ['none', 'classes', 'charts', 'density', 'error']

const at = (id) => document.getElementById(id)

let show
if (LIVE) follow(at('bake'), renew, cannotShow)
else await renew().catch(cannotShow)

/** Shows the model as it is now; the first one starts the page. */
async function renew(signal) {
  const model = await load(signal, globalThis.lightkiln?.model)
  if (show) show(model)
  else show = start(model, new Renderer(at('view'), model))
}

function cannotShow(error) {
  fail(`The scene cannot be shown: ${error.message}`)
  throw error
}

function fail(text) {
  at('failure').textContent = text
  at('failure').hidden = false
}

/** Starts the page on a model, and returns what shows another one in its place. */
function start(model, renderer) {
  let { about } = model
  let choices
  const state = {
    camera: new Camera(about.bounds, about.frame), layer: 0, left: 'hybrid', right: model.has('vertexCodes0') ? 'vertices' : 'none', divider: 0.5, overlay: 'none',
    materials: true, wireframe: false, exposure: 0, harmonics: false, atlas: undefined, picked: undefined,
  }
  const wanted = {}
  const atlas = { middle: [0, 0], zoom: 1, box: undefined }
  let waiting = false

  renderer.arrived = draw

  /** Draws once before the next picture, however often it is asked for. */
  function draw() {
    if (waiting) return
    waiting = true
    requestAnimationFrame(() => {
      waiting = false
      paint()
    })
  }

  function paint() {
    const shown = model.hasAtlas && at('show-atlas').checked
    at('atlas').hidden = !shown
    state.atlas = shown ? Object.assign(atlas, { box: at('atlas').getBoundingClientRect() }) : undefined
    renderer.draw(state)
  }

  const options = (list) => list.map(([value, text]) => Object.assign(document.createElement('option'), { value, textContent: text }))
  const has = { hybrid: () => about.lit, vertices: (layer) => model.has(`vertexCodes${layer}`), full: (layer) => about.layers[layer].fullPages > 0, fallback: (layer) => model.has('fallback') && layer === 0, none: () => true }
  const known = (name, layer) => has[name](layer)

  /** What there is to choose, and the figures. */
  function modelChosen() {
    document.title = `${about.name} - Lightkiln`
    at('name').textContent = about.name
    choices = about.layers.map((layer, number) => [String(number), layer.signal])
    if (model.harmonics.length > 0) choices.push(['harmonics', 'irradiance at the normal'])
    if (state.harmonics ? model.harmonics.length === 0 : state.layer >= about.layers.length) Object.assign(state, { layer: 0, harmonics: false })
    at('layer').replaceChildren(...options(choices))
    at('layer').disabled = !about.lit
    const line = (label, value) => [Object.assign(document.createElement('dt'), { textContent: label }), Object.assign(document.createElement('dd'), { textContent: value })]
    const classes = about.lit ? ['texture', 'mixed', 'color'].map((kind) => [`${kind} triangles`, about.classes[kind].toLocaleString('en')]) : []
    at('figures').replaceChildren(...[...(about.figures.lines ?? []), ...classes].flatMap(([label, value]) => line(label, value)))
    layerChosen()
  }

  function layerChosen() {
    const ways = Object.entries(SHOWN).filter(([name]) => known(name, state.layer))
    for (const side of ['left', 'right']) {
      // What was chosen comes back as soon as it is there again.
      wanted[side] ??= state[side]
      state[side] = [wanted[side], side === 'left' ? 'hybrid' : 'none', 'none'].find((name) => known(name, state.layer))
      at(side).replaceChildren(...options(ways))
    }
  }

  /** Shows in the controls what the state says, and draws. */
  function update() {
    at('layer').value = state.harmonics ? 'harmonics' : state.layer
    for (const side of ['left', 'right']) {
      at(side).value = state[side]
      at(`${side}-name`).textContent = SHOWN[state[side]]
    }
    at('overlay').value = state.overlay
    at('exposure').value = state.exposure
    at('exposure-label').hidden = !(about.layers[state.layer].white > 0 || state.materials)
    for (const name of ['materials', 'wireframe']) at(name).checked = state[name]
    legend(at('legend'), state.overlay, about)
    const percent = 100 * state.divider
    at('divider').style.left = `${percent}%`
    at('divider').setAttribute('aria-valuenow', Math.round(percent))
    // On a phone the divider ends above what lies along the lower edge.
    const isPhone = innerWidth <= 704
    const hasAtlas = model.hasAtlas && at('show-atlas').checked
    const along = isPhone ? [at('legend'), at('atlas'), at('bake')].filter((box) => (box === at('atlas') ? hasAtlas : !box.hidden)) : []
    const end = Math.min(innerHeight, ...along.map((box) => box.getBoundingClientRect().top))
    at('divider').style.bottom = `${innerHeight - end}px`
    // Names keep clear of the atlas, which is below them there.
    const edge = !isPhone && hasAtlas ? at('atlas').getBoundingClientRect().left : innerWidth
    const here = state.divider * innerWidth
    at('left-name').style.left = `${Math.min(here, edge)}px`
    at('right-name').style.left = `${here}px`
    at('left-name').hidden = state.divider < 0.12
    at('right-name').hidden = false
    at('right-name').hidden = at('right-name').getBoundingClientRect().right > edge
    const page = about.pageSize
    const { pages, bits } = about.layers[state.layer]
    at('atlas-name').textContent = model.hasAtlas ? `atlas, ${pages} × ${page[0]} × ${page[1]}, ${bits} bits` : ''
    draw()
  }

  const set = (changes) => {
    Object.assign(state, changes)
    update()
  }
  const setSides = (sides) => {
    Object.assign(wanted, sides)
    set(sides)
  }
  /** A layer by its number, or `harmonics`: those of irradiance together, of which the atlas shows the first. */
  const setLayer = (choice) => {
    state.harmonics = choice === 'harmonics'
    state.layer = state.harmonics ? model.harmonics[0] : Number(choice)
    layerChosen()
    update()
  }
  const setDivider = (share) => set({ divider: Math.min(1, Math.max(0, share)) })

  at('layer').addEventListener('change', (event) => setLayer(event.target.value))
  for (const side of ['left', 'right']) at(side).addEventListener('change', (event) => setSides({ [side]: event.target.value }))
  at('overlay').addEventListener('change', (event) => set({ overlay: event.target.value }))
  for (const name of ['materials', 'wireframe']) at(name).addEventListener('change', (event) => set({ [name]: event.target.checked }))
  at('exposure').addEventListener('input', (event) => set({ exposure: Number(event.target.value) }))
  at('show-atlas').addEventListener('change', update)
  at('help').addEventListener('click', () => at('keys').showModal())
  at('reset').addEventListener('click', reset)
  at('controls').addEventListener('submit', (event) => event.preventDefault())

  function reset() {
    state.camera.reset()
    resetAtlas()
    setDivider(0.5)
  }

  function resetAtlas() {
    if (!model.hasAtlas) return
    const [width, height] = [about.pageSize[0], about.pageSize[1] * about.layers[0].pages]
    const box = at('atlas').getBoundingClientRect()
    atlas.middle = [width / 2, height / 2]
    atlas.zoom = 0.94 * Math.min(box.width / width, box.height / height) || 1
  }

  // Pointers on the scene: one turns, a second one moves and comes closer.
  const canvas = at('view')
  canvas.addEventListener('webglcontextlost', () => fail('The graphics system has dropped the page: load it again.'))
  gestures(canvas, {
    drag: (dx, dy, moves) => {
      const height = canvas.clientHeight
      if (moves) state.camera.move(dx / height, -dy / height)
      else state.camera.turn((4 * dx) / height, (4 * dy) / height)
      draw()
    },
    zoom: (factor) => {
      state.camera.closer(factor)
      draw()
    },
    hover: (x, y) => hover(x, y, false),
  })
  gestures(at('atlas'), {
    drag: (dx, dy) => {
      atlas.middle = [atlas.middle[0] - dx / atlas.zoom, atlas.middle[1] - dy / atlas.zoom]
      draw()
    },
    zoom: (factor, x, y) => {
      const box = at('atlas').getBoundingClientRect()
      const from = [x - (box.left + box.right) / 2, y - (box.top + box.bottom) / 2]
      const before = atlas.zoom
      atlas.zoom = Math.min(64, Math.max(0.01, atlas.zoom * factor))
      // What is under the pointer stays there.
      atlas.middle = atlas.middle.map((m, k) => m + from[k] / before - from[k] / atlas.zoom)
      draw()
    },
    hover: (x, y) => hover(x, y, true),
  })
  gestures(at('divider'), { drag: (dx) => setDivider(state.divider + dx / innerWidth), zoom: () => {}, hover: () => {} })

  /** Marks the triangle under the pointer in the scene and in the atlas, and says what it is. */
  function hover(x, y, inAtlas) {
    const picked = x === undefined ? undefined : renderer.pick(state, x, y, inAtlas)
    state.picked = picked
    const note = at('hover')
    note.textContent = picked ? describe(picked) : ''
    if (picked) {
      const width = note.offsetWidth
      note.style.left = `${Math.min(x, innerWidth - width - 20)}px`
      note.style.top = `${Math.min(y, innerHeight - 50)}px`
    }
    draw()
  }

  function describe({ triangle, weights }) {
    const corners = [...model.corners(triangle)]
    const kind = model.kind(triangle)
    const words = [model.partOf(triangle), `triangle ${triangle.toLocaleString('en')}`, kind]
    if (kind === 'texture') {
      const place = [0, 1].map((k) => corners.reduce((sum, v, c) => sum + weights[c] * model.place(v)[k], 0))
      const page = Math.floor(place[1] / about.pageSize[1])
      const texel = [Math.floor(place[0]), Math.floor(place[1]) - page * about.pageSize[1]]
      words.push(`texel ${texel.join(', ')}`, `chart ${model.charts[corners[2]]}`)
      if (about.layers[0].pages > 1) words.push(`page ${page}`)
    }
    return words.join(', ')
  }

  addEventListener('keydown', (event) => {
    const inField = event.target instanceof HTMLSelectElement || (event.target instanceof HTMLInputElement && event.target.type === 'range')
    if (event.ctrlKey || event.metaKey || event.altKey || inField || at('keys').open) return
    const { camera } = state
    const step = 0.08
    const onDivider = event.target === at('divider')
    const arrow = (x, y) => {
      if (onDivider && x) return setDivider(state.divider + 0.02 * x)
      if (event.shiftKey) camera.move(x * step, y * step)
      else camera.turn(-x * step, y * step)
      draw()
    }
    const closer = (factor) => {
      camera.closer(factor)
      draw()
    }
    const keys = {
      ArrowLeft: () => arrow(-1, 0), ArrowRight: () => arrow(1, 0), ArrowUp: () => arrow(0, 1), ArrowDown: () => arrow(0, -1),
      '+': () => closer(1.15), '=': () => closer(1.15), '-': () => closer(1 / 1.15),
      '[': () => setDivider(state.divider - 0.05), ']': () => setDivider(state.divider + 0.05),
      '{': () => setDivider(0), '}': () => setDivider(1),
      x: () => setSides({ left: state.right, right: state.left }),
      l: () => setLayer(choices[(at('layer').selectedIndex + 1) % choices.length][0]),
      m: () => set({ materials: !state.materials }),
      w: () => set({ wireframe: !state.wireframe }),
      a: () => at('show-atlas').click(),
      r: reset,
      '?': () => at('keys').showModal(),
    }
    OVERLAYS.forEach((overlay, number) => (keys[number] = () => set({ overlay })))
    const act = keys[event.key]
    if (!act) return
    event.preventDefault()
    act()
  })

  addEventListener('resize', update)
  modelChosen()
  // A phone has no room for everything at once.
  if (innerWidth < 700 || innerHeight < 450) at('panel').open = false
  paint()
  resetAtlas()
  update()
  paint()
  // For tests, and for whoever has the console open.
  globalThis.lightkiln = { state, model, renderer, set, setLayer, paint }
  globalThis.ready = true
  return (next) => {
    const hadAtlas = model.hasAtlas
    model = globalThis.lightkiln.model = next
    ;({ about } = model)
    state.picked = undefined
    renderer.show(model)
    modelChosen()
    update()
    paint()
    if (!hadAtlas) resetAtlas()
    draw()
  }
}

/** Drags, wheels, pinches and hovering on an element. */
function gestures(element, { drag, zoom, hover }) {
  const pointers = new Map()
  let hovering
  const gap = () => {
    const [a, b] = [...pointers.values()]
    return Math.hypot(a.x - b.x, a.y - b.y)
  }
  element.addEventListener('pointerdown', (event) => {
    element.setPointerCapture(event.pointerId)
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY })
    hover()
  })
  element.addEventListener('pointermove', (event) => {
    const before = pointers.get(event.pointerId)
    if (!before) {
      // At most once a picture.
      if (!hovering) {
        requestAnimationFrame(() => {
          const { x, y } = hovering
          hovering = undefined
          hover(x, y)
        })
      }
      hovering = { x: event.clientX, y: event.clientY }
      return
    }
    const [dx, dy] = [event.clientX - before.x, event.clientY - before.y]
    const apart = pointers.size === 2 ? gap() : 0
    Object.assign(before, { x: event.clientX, y: event.clientY })
    if (pointers.size === 2) {
      zoom(gap() / Math.max(1, apart), event.clientX, event.clientY)
      drag(dx / 2, dy / 2, true)
    } else {
      drag(dx, dy, (event.buttons & 2) !== 0 || event.shiftKey)
    }
  })
  const end = (event) => pointers.delete(event.pointerId)
  element.addEventListener('pointerup', (event) => {
    end(event)
    // A tap tells what is there: a finger does not hover.
    if (event.pointerType === 'touch') hover(event.clientX, event.clientY)
  })
  element.addEventListener('pointercancel', end)
  element.addEventListener('pointerleave', (event) => event.pointerType !== 'touch' && pointers.size === 0 && hover())
  element.addEventListener('wheel', (event) => {
    event.preventDefault()
    zoom(Math.exp(-event.deltaY * (event.deltaMode === 1 ? 0.05 : 0.0015)), event.clientX, event.clientY)
  }, { passive: false })
  element.addEventListener('contextmenu', (event) => event.preventDefault())
}
