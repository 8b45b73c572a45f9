// Reports and extension objects against the schemas of docs/.
//   node schema.mjs R.json... OUT.glb...
import { readFile } from 'node:fs/promises';
import Ajv from 'ajv/dist/2020.js';
import { json } from './files.mjs';

const EXTENSION = 'LIGHTKILN_lightmap';
const ajv = new Ajv({ allErrors: true });
const schema = async (name) => JSON.parse(await readFile(new URL(`../../docs/${name}`, import.meta.url)));
const report = ajv.compile(await schema('report.schema.json'));
const extension = await schema(`${EXTENSION}.schema.json`);
ajv.addSchema(extension);
const part = (name) => ajv.getSchema(`${extension.$id}#/$defs/${name}`);

let [failed, checked] = [0, 0];
function check(validate, value, where) {
  checked += 1;
  if (validate(value)) return;
  failed += 1;
  for (const { instancePath, message, params } of validate.errors) {
    console.error(`${where}${instancePath}: ${message} ${JSON.stringify(params)}`);
  }
}

for (const path of process.argv.slice(2)) {
  const root = await json(path);
  if (path.endsWith('.json')) {
    check(report, root, path);
    continue;
  }
  check(part('root'), root.extensions?.[EXTENSION], `${path} extensions.${EXTENSION}`);
  for (const [m, mesh] of root.meshes.entries()) {
    for (const [p, primitive] of mesh.primitives.entries()) {
      const ours = primitive.extensions?.[EXTENSION];
      if (ours) check(part('primitive'), ours, `${path} meshes[${m}].primitives[${p}]`);
    }
  }
}
console.log(`schema: ${checked - failed} passed, ${failed} failed`);
process.exitCode = failed > 0 || checked === 0 ? 1 : 0;
