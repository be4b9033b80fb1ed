// "1 frame", "2 frames"; the same as `counted` in words.py.
export const counted = (number, noun, plural = `${noun}s`) => `${number} ${number === 1 ? noun : plural}`;
