// The parts of Node that the unit tests use.

declare module "node:test" {
  export function beforeEach(action: () => void): void;
  export default function test(name: string, action: () => void | Promise<void>): void;
}

declare module "node:assert/strict" {
  const assert: {
    ok(value: unknown, message?: string): void;
    equal(actual: unknown, expected: unknown, message?: string): void;
    deepEqual(actual: unknown, expected: unknown): void;
    notDeepEqual(actual: unknown, expected: unknown): void;
    match(text: string, pattern: RegExp): void;
    throws(action: () => unknown, expected: RegExp): void;
    rejects(promise: Promise<unknown>, expected: object): Promise<void>;
  };
  export default assert;
}

declare module "node:fs" {
  export function readFileSync(path: URL, encoding: "utf-8"): string;
}

interface ImportMeta {
  url: string;
}

declare const Buffer: { from(text: string, encoding: "base64"): Uint8Array };
declare const process: { env: Record<string, string> };
