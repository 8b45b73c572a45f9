// Prints the tables of light in docs/RESULTS.md from the reports of docs/light_sheets.sh.
//   node docs/light.mjs table1|light REPORT.json...
import { readFile } from 'node:fs/promises';
import { basename } from 'node:path';

const count = (number) => number.toLocaleString('en-US');
const share = (part) => `${(100 * part).toFixed(1)} %`;
const seconds = ({ stages }) => stages.reduce((sum, stage) => sum + stage.seconds, 0).toFixed(0);
const beyond = ({ samplesBeyond, colorPoints, colorPointsBeyond }) =>
  `${samplesBeyond} / ${share(colorPoints ? colorPointsBeyond / colorPoints : 0)}`;

const tables = {
  // The columns of Schaefer 2012, table 1.
  table1: {
    head: ['scene', 'signal', 'vertices', 'triangles', 'max E point', 'max E least squares', 'textured area', 'beyond', 'seconds'],
    row: (name, { settings, scene, errors, classes, ...rest }) => [
      name,
      settings.signal,
      count(scene.lightVertices),
      count(scene.triangles),
      errors.pointSampling.max.toFixed(2),
      errors.leastSquares.max.toFixed(2),
      share(classes.texture.areaShare),
      beyond(errors.bound),
      seconds(rest),
    ],
  },
  light: {
    head: ['scene', 'signal', 'triangles', 'textured area', 'KiB', 'of a lightmap', 'point RMSE', 'least squares RMSE', 'hybrid RMSE', 'noise', 'color 99.9 %', 'beyond', 'seconds'],
    row: (name, { settings, scene, errors, classes, bytes, ...rest }) => {
      const full = bytes.fullLightmap.bytes;
      const lightmap = full.attribute + full.addedVertices + full.atlas + full.mips;
      return [
        name,
        settings.signal,
        count(scene.triangles),
        share(classes.texture.areaShare),
        count(Math.round(bytes.total / 1024)),
        (bytes.total / lightmap).toFixed(2),
        errors.pointSampling.rmse.toFixed(3),
        errors.leastSquares.rmse.toFixed(3),
        errors.hybrid.rmse.toFixed(3),
        errors.hybrid.noise.toFixed(3),
        errors.color.p999.toFixed(3),
        beyond(errors.bound),
        seconds(rest),
      ];
    },
  },
};

const [, , which, ...paths] = process.argv;
const { head, row } = tables[which];
const line = (cells) => console.log(`| ${cells.join(' | ')} |`);
line(head);
line(head.map(() => '---'));
for (const path of paths) line(row(basename(path, '.json'), JSON.parse(await readFile(path))));
