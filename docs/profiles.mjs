// Table and picture of docs/PROFILES.md, from reports named SCENE.PROFILE.json.
//   node docs/profiles.mjs REPORT.json... > table; the picture goes to docs/figures/profiles.svg
import { readFile, writeFile } from 'node:fs/promises';
import { basename } from 'node:path';

const PARTS = [
  ['attribute', '#4c78a8', (light) => light.attribute],
  ['split vertices', '#f58518', (light) => light.addedVertices],
  ['texels with mips', '#54a24b', (light) => light.atlas + light.mips],
];
const kib = (bytes) => `${(bytes / 1024).toFixed(1)}`;
const scenes = new Map();
for (const path of process.argv.slice(2)) {
  const [scene, profile] = basename(path).split('.');
  const { bytes, errors } = JSON.parse(await readFile(path));
  if (!scenes.has(scene)) scenes.set(scene, []);
  scenes.get(scene).push({ profile, light: bytes.light, total: bytes.total, errors: errors.hybrid });
}

console.log('| scene | profile | attribute, kiB | split vertices, kiB | texels with mips, kiB | all, kiB | RMSE | 99 % |');
console.log('|---|---|---:|---:|---:|---:|---:|---:|');
for (const [scene, rows] of scenes) {
  for (const { profile, light, total, errors } of rows) {
    const parts = PARTS.map(([, , of]) => kib(of(light)));
    console.log(`| ${[scene, profile, ...parts, kib(total), errors.rmse.toFixed(4), errors.p99.toFixed(3)].join(' | ')} |`);
  }
}

const [left, width, bar, gap] = [90, 520, 16, 26];
const out = [];
let y = 34;
PARTS.forEach(([name, color], k) => {
  out.push(`<rect x="${left + k * 150}" y="10" width="12" height="12" fill="${color}"/>`);
  out.push(`<text x="${left + k * 150 + 18}" y="20">${name}</text>`);
});
for (const [scene, rows] of scenes) {
  const largest = Math.max(...rows.map(({ total }) => total));
  y += gap;
  out.push(`<text x="${left}" y="${y - 6}" font-weight="bold">${scene}</text>`);
  for (const { profile, light, total } of rows) {
    let x = left;
    out.push(`<text x="${left - 8}" y="${y + 12}" text-anchor="end">${profile}</text>`);
    for (const [, color, of] of PARTS) {
      const w = (of(light) / largest) * width;
      out.push(`<rect x="${x.toFixed(1)}" y="${y}" width="${w.toFixed(1)}" height="${bar}" fill="${color}"/>`);
      x += w;
    }
    out.push(`<text x="${(x + 6).toFixed(1)}" y="${y + 12}">${kib(total)} kiB</text>`);
    y += bar + 4;
  }
}
const size = `${left + width + 90} ${y + 10}`;
const svg = `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${size}" font-family="sans-serif" font-size="12" fill="#333">
<rect width="100%" height="100%" fill="#fff"/>
${out.join('\n')}
</svg>
`;
await writeFile(new URL('figures/profiles.svg', import.meta.url), svg);
