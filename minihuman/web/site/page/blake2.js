// BLAKE2b (RFC 7693) of up to 64 bits, without a key: by it screens have their names, in Python and here.

const IV = [
  0x6a09e667f3bcc908n, 0xbb67ae8584caa73bn, 0x3c6ef372fe94f82bn, 0xa54ff53a5f1d36f1n,
  0x510e527fade682d1n, 0x9b05688c2b3e6c1fn, 0x1f83d9abfb41bd6bn, 0x5be0cd19137e2179n,
];
const SIGMA = [
  "0123456789abcdef", "ea489fd61c02b753", "b8c052fdae367194", "7931dcbe265a40f8", "905724afe1bc683d",
  "2c6a0b834d75fe19", "c51fed4a0763928b", "db7ec13950f4862a", "6fe9b308c2d714a5", "a2847615fb9e3cd0",
].map((row) => [...row].map((digit) => parseInt(digit, 16)));
const LANES = [
  [0, 4, 8, 12], [1, 5, 9, 13], [2, 6, 10, 14], [3, 7, 11, 15], [0, 5, 10, 15], [1, 6, 11, 12], [2, 7, 8, 13], [3, 4, 9, 14],
];
const ROUNDS = 12, BLOCK_BYTES = 128, WORD_BYTES = 8;
const MASK = (1n << 64n) - 1n;

/** @param {bigint} word @param {bigint} by */
const rotate = (word, by) => ((word >> by) | (word << (64n - by))) & MASK;

/** @param {bigint[]} h @param {DataView} block @param {bigint} count of bytes so far @param {boolean} isLast */
function compress(h, block, count, isLast) {
  const v = [...h, ...IV], words = SIGMA[0].map((at) => block.getBigUint64(at * WORD_BYTES, true));
  v[12] ^= count;
  if (isLast) v[14] ^= MASK;
  for (let round = 0; round < ROUNDS; round++) {
    const order = SIGMA[round % SIGMA.length];
    LANES.forEach(([a, b, c, d], lane) => {
      v[a] = (v[a] + v[b] + words[order[2 * lane]]) & MASK;
      v[d] = rotate(v[d] ^ v[a], 32n);
      v[c] = (v[c] + v[d]) & MASK;
      v[b] = rotate(v[b] ^ v[c], 24n);
      v[a] = (v[a] + v[b] + words[order[2 * lane + 1]]) & MASK;
      v[d] = rotate(v[d] ^ v[a], 16n);
      v[c] = (v[c] + v[d]) & MASK;
      v[b] = rotate(v[b] ^ v[c], 63n);
    });
  }
  h.forEach((_, at) => { h[at] ^= v[at] ^ v[at + WORD_BYTES]; });
}

/** The digest of 8 bytes, as a number of little-endian bytes. @param {string} text in UTF-8 @returns {bigint} */
export function digestText(text) {
  const bytes = new TextEncoder().encode(text);
  const h = [...IV];
  h[0] ^= 0x01010000n ^ BigInt(WORD_BYTES); // the parameters: one leaf, no key, 8 bytes
  const blocks = Math.max(1, Math.ceil(bytes.length / BLOCK_BYTES));
  for (let number = 0; number < blocks; number++) {
    const block = new Uint8Array(BLOCK_BYTES);
    block.set(bytes.subarray(number * BLOCK_BYTES, (number + 1) * BLOCK_BYTES));
    const isLast = number === blocks - 1;
    compress(h, new DataView(block.buffer), BigInt(isLast ? bytes.length : (number + 1) * BLOCK_BYTES), isLast);
  }
  return h[0];
}
