/** Values that pages, links and messages pass to the player. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { plainText, readMetadata } from "../src/stream/metadata.ts";
import { readBackground, readParameters, readSeconds, readSpeed, readSwitch, readView } from "../src/ui/values.ts";

const NOT_NUMBERS = [NaN, Infinity, -Infinity, "1", "", null, undefined, {}, [], [1], true, 1n, 1e300];

void test("numbers are numbers", () => {
  for (const value of NOT_NUMBERS) {
    assert.throws(() => readSeconds(value), RangeError);
    assert.throws(() => readSpeed(value), RangeError);
  }
  for (const value of [0, 0.09, -1, 4.1]) assert.throws(() => readSpeed(value), /0\.1 to 4/);
  assert.deepEqual([readSpeed(0.1), readSpeed(4), readSeconds(-1), readSeconds(3.5)], [0.1, 4, -1, 3.5]);
  for (const value of [0, 1, "true", null, undefined]) assert.throws(() => readSwitch(value, "setLoop"), /setLoop/);
  assert.equal(readSwitch(false, "setLoop"), false);
});

void test("a background is one that there is", () => {
  for (const value of ["constructor", "toString", "__proto__", "", "White", 1, null, undefined, ["white"]])
    assert.throws(() => readBackground(value), /white/);
  assert.equal(readBackground("white"), "white");
});

void test("a view has the right parts", () => {
  const numbers = NOT_NUMBERS.filter((value) => value !== undefined);
  for (const value of numbers)
    for (const name of ["azimuth", "elevation", "distance"]) assert.throws(() => readView({ azimuth: 1, [name]: value }), RangeError);
  for (const distance of [0, -2]) assert.throws(() => readView({ distance }), RangeError);
  for (const target of [[], [1, 2], [1, 2, 3, 4], ["1", "2", "3"], [NaN, 0, 0], "1,2,3", { 0: 1, 1: 2, 2: 3, length: 3 }])
    assert.throws(() => readView({ target }), RangeError);
  for (const value of [null, undefined, 5, true, [], {}, { zoom: 2 }, { azimuth: 1, zoom: 2 }, "", "1", "1,2,3,4", "a,b", "1e300,2"])
    assert.throws(() => readView(value), /azimuth/);
  assert.deepEqual(readView({ elevation: 3 }), { elevation: 3 });
  assert.deepEqual(readView("1,2,3,4,5,6"), { azimuth: 1, elevation: 2, distance: 3, target: [4, 5, 6] });
});

void test("of a link, what is usable is used, and the rest is named", () => {
  const read = (text: string, takesSource = false): unknown[] => {
    const { attributes, time, view, ignored } = readParameters(new URLSearchParams(text), takesSource);
    return [Object.fromEntries(attributes), time, view, ignored];
  };
  assert.deepEqual(read(""), [{}, null, null, []]);
  const all = "t=1.5&view=1,2&background=white&decoder=video";
  assert.deepEqual(read(all), [{ background: "white", decoder: "video" }, 1.5, { azimuth: 1, elevation: 2 }, []]);
  assert.deepEqual(read("t=-1&view=1&background=constructor&decoder=toString"), [
    {}, null, null, ["background", "decoder", "time", "view"],
  ]);
  for (const time of ["", "NaN", "Infinity", "1e400", "x", "1,2"]) assert.deepEqual(read(`t=${time}`), [{}, null, null, ["time"]]);
  assert.deepEqual(read("src=https://example.org/other/"), [{}, null, null, ["video"]]);
  assert.deepEqual(read("src=other/", true), [{ src: "other/" }, null, null, []]);
  assert.deepEqual(read("src=", true), [{}, null, null, ["video"]]); // or the page would show nothing
});

void test("a title is one line that looks like what it is", () => {
  const cases: Readonly<Record<string, string>> = {
    "\u202eevil\u202c \u2066walk\u2069\u200f": "evil walk",
    " a\x00b\x1b[31m\x7f\x9b\u061c ": "ab[31m",
    "one\ntwo\t three\u2028four": "one two three four",
    "\u{1f468}\u200d\u{1f469} \u0645\u06cc\u200c\u062e": "\u{1f468}\u200d\u{1f469} \u0645\u06cc\u200c\u062e",
  };
  for (const [text, plain] of Object.entries(cases)) {
    assert.equal(plainText(text), plain);
    assert.equal(readMetadata({ title: text }).title, plain);
  }
});
