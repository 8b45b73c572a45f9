// Khronos validator over baked files: a bake must not add an error to what its input already had.
//   node validate.mjs IN.glb... -- OUT.glb...      (as many outputs as inputs, in the same order)
import { addsNoError } from './files.mjs';

const cut = process.argv.indexOf('--');
const inputs = process.argv.slice(2, cut);
const outputs = process.argv.slice(cut + 1);
if (cut < 0 || inputs.length !== outputs.length || inputs.length === 0) {
  console.error('usage: validate.mjs IN... -- OUT...');
  process.exit(1);
}

let failed = 0;
for (let i = 0; i < inputs.length; i += 1) {
  if (!(await addsNoError(inputs[i], outputs[i]))) failed += 1;
}
console.log(`validator: ${outputs.length - failed} passed, ${failed} failed`);
process.exitCode = failed > 0 ? 1 : 0;
