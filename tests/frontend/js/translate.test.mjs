// Texts of the scripts: English without a catalogue, else its translation with the values at their places.
import assert from "node:assert/strict";
import test, { beforeEach } from "node:test";

globalThis.document = /** @type {any} */ ({ documentElement: { lang: "fr" } });
const { translate, translateCount, translateServed } = await import(
  "../../../frontend/stridelab_web/static/js/shared/translate.js"
);
delete (/** @type {any} */ (globalThis).document);

beforeEach(() => {
  globalThis.stridelabMessages = undefined;
  globalThis.stridelabSentences = undefined;
});

test("without a catalogue, texts are English", () => {
  assert.equal(translate("Upload of %(file)s", { file: "a%(b)s.c3d" }), "Upload of a%(b)s.c3d");
  assert.equal(translateCount("%(num)s frame", "%(num)s frames", 1), "1 frame");
  assert.equal(translateCount("%(num)s frame", "%(num)s frames", 2), "2 frames");
  assert.equal(translateServed("Sensors agree"), "Sensors agree");
});

test("a plural form is that of the language of the page: in French, zero is singular", () => {
  globalThis.stridelabMessages = { "%(num)s frame": ["%(num)s image", "%(num)s images"] };
  const shown = [0, 1, 2].map((num) => translateCount("%(num)s frame", "%(num)s frames", num));
  assert.deepEqual(shown, ["0 image", "1 image", "2 images"]);
});

test("a language without plural has one form", () => {
  globalThis.stridelabMessages = { "%(num)s frame": ["%(num)s フレーム"] };
  assert.equal(translateCount("%(num)s frame", "%(num)s frames", 1), "1 フレーム");
});

test("sentences of the service keep their values, and checks are translated", () => {
  globalThis.stridelabSentences = ["Doubtful: %(checks)s", "took %(time)s s (%(n)s of 3)"];
  globalThis.stridelabMessages = {
    "Doubtful: %(checks)s": "Douteux : %(checks)s",
    "%(checks)s and %(number)s more": "%(checks)s et %(number)s autres",
    "force residual": "résidu de force",
    "took %(time)s s (%(n)s of 3)": "%(n)s sur 3 en %(time)s s",
  };
  assert.equal(
    translateServed("Doubtful: force residual, gain and 2 more"),
    "Douteux : résidu de force, gain et 2 autres",
  );
  assert.equal(translateServed("took 1.5 s (2 of 3)"), "2 sur 3 en 1.5 s");
  assert.equal(translateServed("took 1.5 s"), "took 1.5 s");
});

test("a progress message is translated part by part, or not at all", () => {
  globalThis.stridelabSentences = ["planning the centre of mass", "improved %(number)s times so far"];
  globalThis.stridelabMessages = {
    "planning the centre of mass": "planification du centre de masse",
    "improved %(number)s times so far": "amélioré %(number)s fois",
  };
  assert.equal(
    translateServed("planning the centre of mass: improved 12 times so far"),
    "planification du centre de masse: amélioré 12 fois",
  );
  assert.equal(translateServed("planning the centre of mass: unknown"), "planning the centre of mass: unknown");
});
