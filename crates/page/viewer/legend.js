// What the colors of an overlay mean.

const RAMP = 'linear-gradient(to right, rgb(36 97 190), rgb(243 243 243), rgb(205 48 39))'

const CLASSES = [
  ['texture', 'rgb(237 97 89)', 'reads the atlas'],
  ['mixed', 'rgb(249 211 89)', 'blends atlas and vertices'],
  ['color', 'rgb(225 231 237)', 'vertex values'],
]

export function legend(box, overlay, about) {
  const parts = {
    none: () => [],
    classes: () => [list(CLASSES.map(([name, color, what]) => [color, `${name}: ${what}, ${about.classes[name].toLocaleString('en')}`]))],
    charts: () => [note(`${about.charts.toLocaleString('en')} charts, in squares of 2 × 2 texels`)],
    density: () => [ramp(['half', 'as asked', 'twice']), note(`texels a length, against a texel of ${about.texelSize.toPrecision(3)}`)],
    error: () => {
      if (!about.sections.errors) return [note('no errors here: view the file with --trace')]
      const bound = Number(about.maxError.toPrecision(3))
      const ticks = [-2, -1, 0, 1, 2].map((k) => String(Number((k * bound).toPrecision(2))))
      const points = (about.sections.errors.bytes / 16).toLocaleString('en')
      return [ramp(ticks), note(`what the file shows is too dark, right or too bright, at ${points} traced points; the bound is ${bound}`)]
    },
  }[overlay]()
  box.replaceChildren(...parts)
  box.hidden = parts.length === 0
}

function element(name, properties = {}, ...children) {
  const made = Object.assign(document.createElement(name), properties)
  made.append(...children)
  return made
}

function list(items) {
  return element('ul', {}, ...items.map(([color, text]) => {
    const box = element('i')
    box.style.background = color
    return element('li', {}, box, text)
  }))
}

function ramp(ticks) {
  const bar = element('div', { className: 'ramp' })
  bar.style.background = RAMP
  return element('div', {}, bar, element('div', { className: 'ticks' }, ...ticks.map((t) => element('span', {}, t))))
}

function note(text) {
  return element('p', {}, text)
}
