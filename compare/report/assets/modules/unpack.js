// @ts-check
/** Decode typed arrays from the data of the page. */

/**
 * An encoded array: little-endian numbers of a kind, in base64.
 * @typedef {{kind: "f4" | "i4" | "u2" | "u1", data: string}} Packed
 * @typedef {Float32Array | Int32Array | Uint16Array | Uint8Array} Numbers
 */

const KINDS = { f4: Float32Array, i4: Int32Array, u2: Uint16Array, u1: Uint8Array };

/**
 * The numbers of an encoded array; undefined values are NaN.
 * @param {Packed} packed
 * @returns {Numbers}
 */
export function unpack(packed) {
  const text = atob(packed.data);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return new KINDS[packed.kind](bytes.buffer);
}

/**
 * The same data with every encoded array decoded, at any depth.
 * @param {any} value
 * @returns {any}
 */
export function unpackAll(value) {
  if (value === null || typeof value !== "object") return value;
  if (typeof value.kind === "string" && typeof value.data === "string") return unpack(value);
  if (Array.isArray(value)) return value.map(unpackAll);
  return Object.fromEntries(Object.entries(value).map(([name, each]) => [name, unpackAll(each)]));
}
