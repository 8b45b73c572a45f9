// Prints the table of docs/RESULTS.md from the reports of `lightkiln bake --report`.
//   node docs/results.mjs REPORT.json...
import { readFile } from 'node:fs/promises';
import { basename } from 'node:path';

const kib = (bytes) => Math.round(bytes / 1024).toLocaleString('en-US');
const share = (part) => `${(100 * part).toFixed(1)} %`;
console.log('| scene | triangles | textured area | charts | bytes, kiB | full lightmap, kiB | ratio | point RMSE | least squares RMSE | hybrid RMSE | color 99.9 % | beyond | seconds | MiB |');
console.log('|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|');
for (const path of process.argv.slice(2)) {
  const { input, scene, classes, atlas, bytes, errors, stages, peakMemoryBytes } = JSON.parse(await readFile(path));
  const full = bytes.fullLightmap.bytes;
  const lightmap = full.attribute + full.addedVertices + full.atlas + full.mips;
  const { colorPoints, colorPointsBeyond, samplesBeyond } = errors.bound;
  const row = [
    basename(input, '.glb'),
    scene.triangles.toLocaleString('en-US'),
    share(classes.texture.areaShare),
    atlas.charts,
    kib(bytes.total),
    kib(lightmap),
    (bytes.total / lightmap).toFixed(2),
    errors.pointSampling.rmse.toFixed(4),
    errors.leastSquares.rmse.toFixed(4),
    errors.hybrid.rmse.toFixed(4),
    errors.color.p999.toFixed(3),
    `${samplesBeyond} / ${share(colorPoints ? colorPointsBeyond / colorPoints : 0)}`,
    stages.reduce((sum, stage) => sum + stage.seconds, 0).toFixed(1),
    Math.round(peakMemoryBytes / 1048576),
  ];
  console.log(`| ${row.join(' | ')} |`);
}
