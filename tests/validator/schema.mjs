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

function expect(holds, message) {
  checked += 1;
  if (holds) return;
  failed += 1;
  console.error(message);
}

for (const path of process.argv.slice(2)) {
  const root = await json(path);
  if (path.endsWith('.json')) {
    check(report, root, path);
    continue;
  }
  const ours = root.extensions?.[EXTENSION];
  check(part('root'), ours, `${path} extensions.${EXTENSION}`);
  // What a schema cannot say: names follow the order of the layers, textures exist, primitives have all layers.
  const profile = ours?.profile ?? 'eta';
  const plain = ['stock', 'lightmap'].includes(profile);
  const ourNames = (ours?.layers ?? []).map((_, k) => (k === 0 ? '_LIGHTUV' : `_LIGHTUV_${k}`));
  const attributes = plain ? 1 : ourNames.length;
  for (const [k, layer] of (ours?.layers ?? []).entries()) {
    const where = `${path} layers[${k}]`;
    const named = profile === 'eta' ? ourNames[k] : undefined;
    expect(layer.attribute === named, `${where}.attribute: ${layer.attribute} instead of ${named}`);
    expect((layer.codes === 'coordinates') === plain, `${where}.codes: ${layer.codes} in the profile ${profile}`);
    expect(layer.pages?.length === ours.layers[0].pages?.length, `${where}.pages: not as many as in layers[0]`);
    expect(layer.range?.[0] < layer.range?.[1], `${where}.range: ${layer.range}`);
    for (const texture of [...(layer.pages ?? []), layer.table].filter((t) => t !== undefined)) {
      const image = root.textures?.[texture]?.source;
      expect(root.images?.[image] !== undefined, `${where}: texture ${texture} has no image`);
    }
  }
  for (const [m, mesh] of root.meshes.entries()) {
    for (const [p, primitive] of mesh.primitives.entries()) {
      const lit = primitive.extensions?.[EXTENSION];
      if (!lit) continue;
      const where = `${path} meshes[${m}].primitives[${p}]`;
      check(part('primitive'), lit, where);
      // The last sets of texture coordinates, where it is these.
      const sets = Object.keys(primitive.attributes).filter((name) => name.startsWith('TEXCOORD_')).length;
      const last = Array.from({ length: attributes }, (_, k) => `TEXCOORD_${sets - attributes + k}`);
      const names = profile === 'eta' ? ourNames : last;
      expect(JSON.stringify(lit.attributes) === JSON.stringify(names), `${where}: attributes ${lit.attributes}`);
      for (const name of names) {
        const { componentType, type, count, normalized = false } = root.accessors[primitive.attributes[name]] ?? {};
        const same = count === root.accessors[primitive.attributes.POSITION].count;
        const number = profile === 'texcoord' ? 5126 : 5123;
        const fits = componentType === number && normalized === plain && type === 'VEC2' && same;
        expect(fits, `${where}.${name}: not two numbers a vertex as the profile ${profile} has them`);
      }
      if (!plain) continue;
      const mappings = primitive.extensions.KHR_materials_variants?.mappings ?? [];
      for (const { material } of [primitive, ...mappings]) {
        const { occlusionTexture, extensions } = root.materials[material] ?? {};
        const shown = [occlusionTexture, extensions?.MOZ_lightmap].filter((info) => info && ours.layers.some(({ pages }) => pages[0] === info.index));
        expect(shown.every(({ texCoord = 0 }) => `TEXCOORD_${texCoord}` === names[0]), `${where}: material ${material} reads another set`);
      }
    }
  }
}
console.log(`schema: ${checked - failed} passed, ${failed} failed`);
process.exitCode = failed > 0 || checked === 0 ? 1 : 0;
