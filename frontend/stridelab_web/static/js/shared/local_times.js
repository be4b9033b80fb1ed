// Replaces the UTC times of the page by local times with their zone.
/** @param {number} number */
const twoDigits = (number) => String(number).padStart(2, "0");
/** @type {(year: number, month: number, day: number, hour: number, minute: number) => string} */
const formatMinute = (year, month, day, hour, minute) =>
  `${year}-${twoDigits(month)}-${twoDigits(day)} ${twoDigits(hour)}:${twoDigits(minute)}`;
const ZONE = new Intl.DateTimeFormat(undefined, { timeZoneName: "short" });

/** @param {Date} date */
const zoneName = (date) => ZONE.formatToParts(date).find((part) => part.type === "timeZoneName")?.value;
/** @param {Date} date */
const formatUtc = (date) =>
  `${formatMinute(date.getUTCFullYear(), date.getUTCMonth() + 1, date.getUTCDate(), date.getUTCHours(), date.getUTCMinutes())} UTC`;

// An ISO 8601 time as local time to the minute: "2026-11-23 01:54 GMT-5".
/** @param {string} iso */
export function localTime(iso) {
  const date = new Date(iso);
  return `${formatMinute(date.getFullYear(), date.getMonth() + 1, date.getDate(), date.getHours(), date.getMinutes())} ${zoneName(date)}`;
}

// Replaces the text of <time datetime> below `root`, and the time `data-at-time` in elements that contain only text.
/** @param {{ querySelectorAll(selectors: string): Iterable<any> }} root */
export function localiseTimes(root) {
  for (const time of root.querySelectorAll("time[datetime]")) time.textContent = localTime(time.dateTime);
  for (const node of root.querySelectorAll("[data-at-time]")) {
    node.textContent = node.textContent.replace(
      formatUtc(new Date(node.dataset.atTime)),
      localTime(node.dataset.atTime),
    );
  }
}

if (typeof document !== "undefined") localiseTimes(document); // not in the unit tests
