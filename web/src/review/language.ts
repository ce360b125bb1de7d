/** All words of the review, in the language of the page's player. English is complete by definition. */

import { languageOf } from "../ui/first_words.ts";
import type { Same } from "../ui/words.ts";

const ENGLISH = {
  review: "Review", loading: "Loading the review …", broken: (why: string) => `The review cannot be loaded: ${why}`,
  compare: "Compare", compareWith: "Compare with footage", endCompare: "End comparison", whole: "whole image",
  camera: "Compare with the footage of a camera", wipe: "Wipe between footage and 3D video", video: "3D video",
  footage: (camera: string, undistorted: boolean) => `Footage of ${camera}${undistorted ? ", without lens distortion" : ""}`,
  isLoading: "loading", unavailable: (why: string) => `not available: ${why}`, dragLine: "drag the line",
  comment: "Comment", below: "below", marksView: "marks this frame and view",
  mark: "Mark this frame", note: "Note", name: "Your name", remove: "Remove mark", save: "Save", cancel: "Cancel",
  point: "Tap the image to point at a place.", unreadable: (why: string) => `The marks cannot be read: ${why}`,
  finish: "Save or cancel this note first.", noteOn: (frame: number) => `Note on frame ${frame}`,
  notSaved: (why: string) => `The mark was not saved: ${why}`, removed: "The mark was removed.",
  changed: (note: string, author: string) => `It is now “${note}”${author === "" ? "" : ` (${author})`}.`, replace: "Save again to replace it.",
  goTo: (frame: number) => `Go to frame ${frame}`, noNote: "(no note)", edit: "Edit", editMark: (frame: number) => `Edit the mark at frame ${frame}`,
  frame: (frame: number) => `Frame ${frame}`, markAt: (frame: number) => `Mark at frame ${frame}`,
  grades: { good: "good", "visible loss": "visible loss", bad: "bad" }, unmeasured: "not measured", notYet: "Not measured yet.",
  time: (grade: string, share: string) => `${grade} ${share} of the time`, belowOne: "below 1%",
  quality: (parts: string) => `Quality: ${parts}.`, worst: "Worst moments:", numbers: "Numbers",
  heldOut: "held-out", training: "training", oneCamera: (kind: string, name: string) => `${kind} camera ${name}`,
  meanOf: (count: number, kind: string) => `mean of ${count} ${kind} cameras`, range: (low: number, high: number) => `${low} to ${high}`,
  curves: (title: string, cameras: string, range: string) => `${title} of each frame, ${cameras}: before baking and decoded, ${range}`,
  decoded: "decoded", trained: "trained", beforeBaking: "trained (before baking)", only: (what: string) => `${what} only`,
  sizes: (range: string) => `Size of each frame, ${range}`, sizeOf: "size: the group's files, divided by its frames", size: "size",
};

type ReviewWords = Same<typeof ENGLISH>;

const GERMAN: ReviewWords = {
  review: "Durchsicht", loading: "Die Durchsicht wird geladen …", broken: (why) => `Die Durchsicht lässt sich nicht laden: ${why}`,
  compare: "Vergleichen", compareWith: "Mit Aufnahme vergleichen", endCompare: "Vergleich beenden", whole: "ganzes Bild",
  camera: "Mit der Aufnahme einer Kamera vergleichen", wipe: "Trennlinie zwischen Aufnahme und 3D-Video", video: "3D-Video",
  footage: (camera, undistorted) => `Aufnahme von ${camera}${undistorted ? ", ohne Verzeichnung" : ""}`,
  isLoading: "wird geladen", unavailable: (why) => `nicht verfügbar: ${why}`, dragLine: "die Linie ziehen",
  comment: "Anmerken", below: "unten", marksView: "markiert dieses Bild und diese Ansicht",
  mark: "Dieses Bild markieren", note: "Anmerkung", name: "Ihr Name", remove: "Markierung entfernen", save: "Speichern", cancel: "Abbrechen",
  point: "Tippen Sie auf die Stelle im Bild, um die es geht.", unreadable: (why) => `Die Markierungen sind nicht lesbar: ${why}`,
  finish: "Speichern oder verwerfen Sie zuerst diese Anmerkung.", noteOn: (frame) => `Anmerkung zu Bild ${frame}`,
  notSaved: (why) => `Die Markierung wurde nicht gespeichert: ${why}`, removed: "Die Markierung wurde entfernt.",
  changed: (note, author) => `Sie lautet jetzt „${note}“${author === "" ? "" : ` (${author})`}.`, replace: "Erneut speichern, um sie zu ersetzen.",
  goTo: (frame) => `Zu Bild ${frame}`, noNote: "(ohne Anmerkung)", edit: "Ändern", editMark: (frame) => `Markierung bei Bild ${frame} ändern`,
  frame: (frame) => `Bild ${frame}`, markAt: (frame) => `Markierung bei Bild ${frame}`,
  grades: { good: "gut", "visible loss": "sichtbarer Verlust", bad: "schlecht" }, unmeasured: "nicht gemessen", notYet: "Noch nicht gemessen.",
  time: (grade, share) => `${grade} ${share} der Zeit`, belowOne: "unter 1 %",
  quality: (parts) => `Qualität: ${parts}.`, worst: "Schlechteste Stellen:", numbers: "Zahlen",
  heldOut: "zurückgehaltene", training: "trainierte", oneCamera: (kind, name) => `${kind} Kamera ${name}`,
  meanOf: (count, kind) => `Mittel über ${count} ${kind} Kameras`, range: (low, high) => `${low} bis ${high}`,
  curves: (title, cameras, range) => `${title} jedes Bildes, ${cameras}: vor dem Kodieren und dekodiert, ${range}`,
  decoded: "dekodiert", trained: "trainiert", beforeBaking: "trainiert (vor dem Kodieren)", only: (what) => `nur ${what}`,
  sizes: (range) => `Größe jedes Bildes, ${range}`, sizeOf: "Größe: die Dateien der Gruppe durch die Zahl ihrer Bilder", size: "Größe",
};

const JAPANESE: ReviewWords = {
  review: "レビュー", loading: "レビューを読み込み中…", broken: (why) => `レビューを読み込めません: ${why}`,
  compare: "比較", compareWith: "撮影映像と比較", endCompare: "比較を終了", whole: "画像全体",
  camera: "カメラの撮影映像と比較", wipe: "撮影映像と3D動画の境界", video: "3D動画",
  footage: (camera, undistorted) => `${camera}の撮影映像${undistorted ? " (レンズの歪みを補正)" : ""}`,
  isLoading: "読み込み中", unavailable: (why) => `利用できません: ${why}`, dragLine: "線をドラッグ",
  comment: "コメント", below: "下", marksView: "このフレームとビューにマークを付ける",
  mark: "このフレームにマーク", note: "メモ", name: "お名前", remove: "マークを削除", save: "保存", cancel: "キャンセル",
  point: "画像をタップすると場所を示せます。", unreadable: (why) => `マークを読み込めません: ${why}`,
  finish: "先にこのメモを保存するかキャンセルしてください。", noteOn: (frame) => `フレーム${frame}のメモ`,
  notSaved: (why) => `マークは保存されませんでした: ${why}`, removed: "マークは削除されました。",
  changed: (note, author) => `現在の内容は「${note}」${author === "" ? "" : ` (${author})`}です。`, replace: "もう一度保存すると置き換えます。",
  goTo: (frame) => `フレーム${frame}へ`, noNote: "(メモなし)", edit: "編集", editMark: (frame) => `フレーム${frame}のマークを編集`,
  frame: (frame) => `フレーム${frame}`, markAt: (frame) => `フレーム${frame}のマーク`,
  grades: { good: "良好", "visible loss": "劣化が見える", bad: "不良" }, unmeasured: "未測定", notYet: "まだ測定されていません。",
  time: (grade, share) => `${grade} ${share}`, belowOne: "1%未満",
  quality: (parts) => `品質 (時間の割合): ${parts}`, worst: "最も悪い箇所:", numbers: "数値",
  heldOut: "評価用", training: "学習用", oneCamera: (kind, name) => `${kind}カメラ${name}`,
  meanOf: (count, kind) => `${kind}カメラ${count}台の平均`, range: (low, high) => `${low}~${high}`,
  curves: (title, cameras, range) => `各フレームの${title}、${cameras}: ベイク前と復号後、${range}`,
  decoded: "復号後", trained: "学習後", beforeBaking: "学習後 (ベイク前)", only: (what) => `${what}のみ`,
  sizes: (range) => `各フレームのサイズ、${range}`, sizeOf: "サイズ: グループのファイルをフレーム数で割った値", size: "サイズ",
};

/** In tests of functions, there is no page. */
const player = (globalThis as Partial<typeof globalThis>).document?.querySelector<HTMLElement>("v3-player[page]") ?? null;
export const LANGUAGE = player === null ? "en" : languageOf(player);
export const WORDS = { en: ENGLISH, de: GERMAN, ja: JAPANESE }[LANGUAGE];
