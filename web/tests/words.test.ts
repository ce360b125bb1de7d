/** Messages about streams in other languages. */

import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { test } from "node:test";
import { inLanguage, MESSAGES } from "../src/ui/words.ts";

void test("messages are in the viewer's language, also those within others", () => {
  const again = "The server cannot be reached; trying again.";
  assert.equal(inLanguage(again, "en"), again);
  assert.equal(inLanguage(again, "de"), "Der Server ist nicht erreichbar; neuer Versuch.");
  assert.equal(inLanguage(again, "ja"), "サーバーに接続できません。再試行しています。");
  const skipped = "files/ab.mp4 is damaged: its SHA-256 does not match the manifest. Frames 5 to 8 are skipped.";
  assert.equal(inLanguage(skipped, "de"), "files/ab.mp4 ist beschädigt: SHA-256 passt nicht zum Manifest. Die Bilder 5 bis 8 werden übersprungen.");
  assert.equal(inLanguage("Something else.", "de"), "Something else.");
});

void test("each translated message is one of the player's", () => {
  const source = new URL("../../src/", import.meta.url);
  const files = readdirSync(source, { recursive: true }).map(String).filter((name) => name.endsWith(".ts") && !name.endsWith("ui/words.ts"));
  const text = files.map((name) => readFileSync(new URL(name, source), "utf8")).join("\n");
  for (const [english, translations] of Object.entries(MESSAGES)) {
    for (const piece of english.split("{}")) assert.ok(text.includes(piece.replace(/^\.$/, "")), english);
    for (const translation of translations) assert.equal(translation.split("{}").length, english.split("{}").length, english);
  }
});
