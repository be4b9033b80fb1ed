// "1 frame", "2 frames"; the same as in formatting.py.
/** @param {number} number @param {string} noun */
export const counted = (number, noun, plural = `${noun}s`) => `${number} ${number === 1 ? noun : plural}`;
