// Prints what a JavaScript library for HDF5 reads of a bundle, as JSON.
//
//     node foreign.mjs h5wasm|jsfive FOLDER FILE PATH...
//
// FOLDER holds node_modules. A path is /group/dataset or /group@attribute.
import { createRequire } from "node:module";
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [library, folder, name, ...paths] = process.argv.slice(2);
const require = createRequire(pathToFileURL(`${folder}/`));
const bytes = readFileSync(name);

function plain(value) {
    if (value instanceof Uint8Array || ArrayBuffer.isView(value)) return Array.from(value, plain);
    if (Array.isArray(value)) return value.map(plain);
    if (typeof value === "bigint") return Number(value);
    return typeof value === "string" ? value.replace(/\0+$/, "") : value;
}

async function opened() {
    if (library === "jsfive") {
        const { File } = require("jsfive");
        return new File(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length), name);
    }
    const h5wasm = await import(pathToFileURL(`${folder}/node_modules/h5wasm/dist/node/hdf5_hl.js`));
    await h5wasm.ready;
    return new h5wasm.File(name, "r");
}

const file = await opened();
const values = {};
for (const path of paths) {
    const [where, attribute] = path.split("@");
    const item = where === "/" ? file : file.get(where);
    let value = attribute === undefined ? item.value : item.attrs[attribute];
    if (attribute !== undefined && library === "h5wasm") value = value.value;
    values[path] = plain(value);
}
console.log(JSON.stringify(values));
