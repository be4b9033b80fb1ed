// Local times with their zone in the place of those in UTC that the page came with; without this script those stay.
const two = (number) => String(number).padStart(2, "0");
const stampOf = (year, month, ...rest) => `${year}-${two(month)}-${two(rest[0])} ${two(rest[1])}:${two(rest[2])}`;
const ZONE = new Intl.DateTimeFormat(undefined, { timeZoneName: "short" });

const zoneOf = (at) => ZONE.formatToParts(at).find((part) => part.type === "timeZoneName")?.value;
const inUtc = (at) =>
  `${stampOf(at.getUTCFullYear(), at.getUTCMonth() + 1, at.getUTCDate(), at.getUTCHours(), at.getUTCMinutes())} UTC`;

// A time stamp of the interface to the minute, where the reader is: "2026-11-23 01:54 GMT-5".
export function local(iso) {
  const at = new Date(iso);
  return `${stampOf(at.getFullYear(), at.getMonth() + 1, at.getDate(), at.getHours(), at.getMinutes())} ${zoneOf(at)}`;
}

// <time datetime> anywhere below `root`, and elements that hold text alone and name their time as data-at-time.
export function localise(root) {
  for (const time of root.querySelectorAll("time[datetime]")) time.textContent = local(time.dateTime);
  for (const node of root.querySelectorAll("[data-at-time]")) {
    node.textContent = node.textContent.replace(inUtc(new Date(node.dataset.atTime)), local(node.dataset.atTime));
  }
}

localise(document);
