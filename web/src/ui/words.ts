/** All words of the controls. English is complete by definition; the type checker compares the others with it. */

import { FIRST_WORDS, type Language, languageOf } from "./first_words.ts";

export const ENGLISH = {
  ...FIRST_WORDS.en, pause: "Pause", soundOn: "Turn sound on", soundOff: "Turn sound off", time: "Time",
  reset: "Reset view", share: "Share", vr: "Watch in VR", ar: "Place in the room (AR)", statistics: "Statistics",
  settings: "Settings", full: "Full screen", notFull: "Exit full screen", help: "Help", close: "Close", more: "More",
  speed: "Speed", atEnd: "At the end", loop: "Loop", stop: "Stop", background: "Background",
  backgrounds: { set: "The set", stream: "As recorded", black: "Black", gray: "Gray", white: "White", green: "Green", none: "Transparent" },
  keys: "Arrow keys turn, Shift and arrow keys move, plus and minus zoom, R resets the view, Space plays and pauses. Question mark: all keys.",
  updated: "This take was updated.", showUpdated: "Show the new version",
  notes: (count: number) => (count === 1 ? "1 note" : `${count} notes`), next: "Next",
  report: "Report of this device", copy: "Copy", reportCopied: "Report copied.", measured: "Measured. Copy the report and send it.",
  measuring: (at: number, end: number) => `Measuring: ${at} of ${end} s of playback`,
  drag: "Drag to turn", pinch: "pinch to zoom", scroll: "scroll to zoom",
  link: "Link", linkTo: "Link to this time and view", whichLink: "Which link",
  copyYourself: "This browser does not let the page copy: copy the selected link yourself.",
  toWatch: "Share link to watch", toWatchMore: "The player alone, without the review.",
  toReview: "Share link to this review", toReviewMore: "Secret: anyone who has it sees the footage and can change marks.",
  copied: "Link to this time and view copied.",
  copiedToWatch: "Link to watch copied. It opens this moment without the review.",
  copiedReview: "Link to this review copied. Anyone who has it sees the footage and can change marks.",
  playing: "Playing", end: "The end",
  paused: (at: string, duration: string) => `Paused at ${at} of ${duration} seconds`,
  place: (at: string, duration: string, frame: number) => `${at} of ${duration} seconds, frame ${frame}`,
  notStream: (name: string) => `${name} is not a stream in one file (.v3s).`,
  unavailable: (what: string, why: string) => `${what} is not available: ${why}.`,
  chosen: (what: string, value: string) => `${what}: ${value}.`,
  silent: "The browser starts without sound. Turn it on with the button below.",
  outside: "Not filmed from here.",
  turn: "Turn", oneFinger: "drag with one finger", leftButton: "left button", move: "Move", twoFingers: "drag with two fingers",
  rightButton: "right button", withAbove: "with the above", zoom: "Zoom", pinchOnly: "pinch", wheel: "wheel",
  doubleTap: "double tap", doubleClick: "double click", controls: "Controls", tap: "tap: show or hide", seek: "Seek",
  dragTimeline: "drag along the timeline", playPause: "Play, pause", space: "Space", second: "Back, forward 1 s",
  frame: "Previous, next frame", slower: "Slower, faster", sound: "Sound", gamepad: "Gamepad",
  gamepadMore: "left stick turns, right stick moves, triggers zoom; A plays, B resets the view",
  figures: {
    rate: "Frame rate", dropped: "Dropped", splats: "Splats", decode: "Decode", dequantize: "Dequantize", sort: "Sort", prepare: "Prepare",
    upload: "Upload", render: "Render", main: "Main thread", image: "Image", bandwidth: "Bandwidth", received: "Received",
    stream: "Stream", rendition: "Rendition", player: "Player", checked: "Checked",
  },
  of: (part: string, whole: string) => `${part} of ${whole}`, perFrame: "per frame", perGroup: "per group", isPaused: "paused",
  frames: (count: string) => (count === "1" ? "1 frame" : `${count} frames`), stalls: "stalls",
  sizesOnly: "sizes only; SHA-256 requires HTTPS", sizes: "sizes and SHA-256",
  placeAR: "Look at a table or the floor. Tap to place.", adjustAR: "Pinch to scale and turn. Tap to move it.",
};

/** A table with the names of `T` and any texts. */
export type Same<T> = { readonly [K in keyof T]: T[K] extends string ? string : T[K] extends (...values: never) => string ? T[K] : Same<T[K]> };

export type Words = Same<typeof ENGLISH>;

const GERMAN: Words = {
  ...FIRST_WORDS.de, pause: "Pause", soundOn: "Ton einschalten", soundOff: "Ton ausschalten", time: "Zeit",
  reset: "Ansicht zurücksetzen", share: "Teilen", vr: "In VR ansehen", ar: "In den Raum stellen (AR)", statistics: "Statistik",
  settings: "Einstellungen", full: "Vollbild", notFull: "Vollbild beenden", help: "Hilfe", close: "Schließen", more: "Mehr",
  speed: "Tempo", atEnd: "Am Ende", loop: "Von vorn", stop: "Anhalten", background: "Hintergrund",
  backgrounds: { set: "Das Set", stream: "Wie aufgenommen", black: "Schwarz", gray: "Grau", white: "Weiß", green: "Grün", none: "Durchsichtig" },
  keys: "Pfeiltasten drehen, Umschalt und Pfeiltasten verschieben, Plus und Minus zoomen, R setzt die Ansicht zurück, die Leertaste spielt ab und hält an. Fragezeichen: alle Tasten.",
  updated: "Diese Aufnahme wurde erneuert.", showUpdated: "Neue Fassung zeigen",
  notes: (count) => (count === 1 ? "1 Anmerkung" : `${count} Anmerkungen`), next: "Weiter",
  report: "Bericht dieses Geräts", copy: "Kopieren", reportCopied: "Bericht kopiert.", measured: "Gemessen. Kopieren und senden Sie den Bericht.",
  measuring: (at, end) => `Messung: ${at} von ${end} s Wiedergabe`,
  drag: "Ziehen zum Drehen", pinch: "zwei Finger zum Zoomen", scroll: "Mausrad zum Zoomen",
  link: "Link", linkTo: "Link zu Zeit und Ansicht", whichLink: "Welcher Link",
  copyYourself: "Dieser Browser lässt die Seite nicht kopieren: Kopieren Sie den markierten Link selbst.",
  toWatch: "Link zum Ansehen teilen", toWatchMore: "Nur der Player, ohne die Abnahme.",
  toReview: "Link zu dieser Abnahme teilen", toReviewMore: "Geheim: Wer ihn hat, sieht das Filmmaterial und kann Anmerkungen ändern.",
  copied: "Link zu Zeit und Ansicht kopiert.",
  copiedToWatch: "Link zum Ansehen kopiert. Er öffnet diesen Moment ohne die Abnahme.",
  copiedReview: "Link zu dieser Abnahme kopiert. Wer ihn hat, sieht das Filmmaterial und kann Anmerkungen ändern.",
  playing: "Läuft", end: "Ende",
  paused: (at, duration) => `Angehalten bei ${at} von ${duration} Sekunden`,
  place: (at, duration, frame) => `${at} von ${duration} Sekunden, Bild ${frame}`,
  notStream: (name) => `${name} ist kein Stream in einer Datei (.v3s).`,
  unavailable: (what, why) => `${what} ist nicht verfügbar: ${why}.`,
  chosen: (what, value) => `${what}: ${value}.`,
  silent: "Der Browser beginnt ohne Ton. Schalten Sie ihn mit dem Knopf unten ein.",
  outside: "Von hier wurde nicht gefilmt.",
  turn: "Drehen", oneFinger: "mit einem Finger ziehen", leftButton: "linke Taste", move: "Verschieben", twoFingers: "mit zwei Fingern ziehen",
  rightButton: "rechte Taste", withAbove: "mit den obigen", zoom: "Zoomen", pinchOnly: "zwei Finger spreizen", wheel: "Mausrad",
  doubleTap: "doppelt tippen", doubleClick: "Doppelklick", controls: "Bedienung", tap: "tippen: zeigen, verbergen", seek: "Springen",
  dragTimeline: "auf der Zeitleiste ziehen", playPause: "Abspielen, Pause", space: "Leertaste", second: "1 s zurück, vor",
  frame: "Voriges, nächstes Bild", slower: "Langsamer, schneller", sound: "Ton", gamepad: "Gamepad",
  gamepadMore: "linker Stick dreht, rechter verschiebt, Trigger zoomen; A spielt ab, B setzt die Ansicht zurück",
  figures: {
    rate: "Bildrate", dropped: "Ausgelassen", splats: "Splats", decode: "Dekodieren", dequantize: "Dequantisieren", sort: "Sortieren",
    prepare: "Vorbereiten", upload: "Hochladen", render: "Zeichnen", main: "Hauptthread", image: "Bildgröße", bandwidth: "Bandbreite",
    received: "Empfangen", stream: "Stream", rendition: "Fassung", player: "Player", checked: "Geprüft",
  },
  of: (part, whole) => `${part} von ${whole}`, perFrame: "je Bild", perGroup: "je Gruppe", isPaused: "angehalten",
  frames: (count) => (count === "1" ? "1 Bild" : `${count} Bildern`), stalls: "Stockungen",
  sizesOnly: "nur Größen; SHA-256 braucht HTTPS", sizes: "Größen und SHA-256",
  placeAR: "Blicken Sie auf einen Tisch oder den Boden. Tippen Sie zum Hinstellen.", adjustAR: "Zwei Finger skalieren und drehen. Tippen versetzt es.",
};

const JAPANESE: Words = {
  ...FIRST_WORDS.ja, pause: "一時停止", soundOn: "音声をオンにする", soundOff: "音声をオフにする", time: "時間",
  reset: "視点をリセット", share: "共有", vr: "VRで見る", ar: "部屋に置く (AR)", statistics: "統計",
  settings: "設定", full: "全画面", notFull: "全画面を終了", help: "ヘルプ", close: "閉じる", more: "その他",
  speed: "速度", atEnd: "終わったら", loop: "繰り返す", stop: "停止", background: "背景",
  backgrounds: { set: "セット", stream: "収録時のまま", black: "黒", gray: "グレー", white: "白", green: "緑", none: "透明" },
  keys: "矢印キーで回転、Shiftと矢印キーで移動、プラスとマイナスでズーム、Rで視点をリセット、スペースで再生と一時停止。疑問符ですべてのキーを表示。",
  updated: "このテイクは更新されました。", showUpdated: "新しい版を表示",
  notes: (count) => `メモ${count}件`, next: "次へ",
  report: "この端末のレポート", copy: "コピー", reportCopied: "レポートをコピーしました。", measured: "測定が終わりました。レポートをコピーして送ってください。",
  measuring: (at, end) => `測定中: 再生${end}秒中${at}秒`,
  drag: "ドラッグで回転", pinch: "ピンチでズーム", scroll: "スクロールでズーム",
  link: "リンク", linkTo: "この時間と視点へのリンク", whichLink: "リンクの種類",
  copyYourself: "このブラウザではページからコピーできません。選択されたリンクを手動でコピーしてください。",
  toWatch: "視聴用リンクを共有", toWatchMore: "レビューなしのプレーヤーのみ。",
  toReview: "このレビューへのリンクを共有", toReviewMore: "秘密のリンク: 知っている人は誰でも映像を見て、マークを変更できます。",
  copied: "この時間と視点へのリンクをコピーしました。",
  copiedToWatch: "視聴用リンクをコピーしました。レビューなしでこの瞬間を開きます。",
  copiedReview: "このレビューへのリンクをコピーしました。知っている人は誰でも映像を見て、マークを変更できます。",
  playing: "再生中", end: "終わり",
  paused: (at, duration) => `${duration}秒中${at}秒で一時停止`,
  place: (at, duration, frame) => `${duration}秒中${at}秒、フレーム${frame}`,
  notStream: (name) => `${name}は単一ファイルのストリーム (.v3s) ではありません。`,
  unavailable: (what, why) => `${what}は利用できません: ${why}`,
  chosen: (what, value) => `${what}: ${value}`,
  silent: "ブラウザは音声なしで再生を始めます。下のボタンでオンにしてください。",
  outside: "この方向からは撮影されていません。",
  turn: "回転", oneFinger: "1本指でドラッグ", leftButton: "左ボタン", move: "移動", twoFingers: "2本指でドラッグ",
  rightButton: "右ボタン", withAbove: "と上記のキー", zoom: "ズーム", pinchOnly: "ピンチ", wheel: "ホイール",
  doubleTap: "ダブルタップ", doubleClick: "ダブルクリック", controls: "操作パネル", tap: "タップで表示・非表示", seek: "シーク",
  dragTimeline: "タイムラインをドラッグ", playPause: "再生、一時停止", space: "スペース", second: "1秒戻る、進む",
  frame: "前、次のフレーム", slower: "遅く、速く", sound: "音声", gamepad: "ゲームパッド",
  gamepadMore: "左スティックで回転、右スティックで移動、トリガーでズーム、Aで再生、Bで視点をリセット",
  figures: {
    rate: "フレームレート", dropped: "欠落", splats: "スプラット", decode: "デコード", dequantize: "逆量子化", sort: "ソート", prepare: "準備",
    upload: "アップロード", render: "描画", main: "メインスレッド", image: "画像", bandwidth: "帯域幅", received: "受信",
    stream: "ストリーム", rendition: "品質", player: "プレーヤー", checked: "検査",
  },
  of: (part, whole) => `${whole}中${part}`, perFrame: "毎フレーム", perGroup: "毎グループ", isPaused: "一時停止",
  frames: (count) => `${count}フレーム`, stalls: "停止", sizesOnly: "サイズのみ (SHA-256にはHTTPSが必要)", sizes: "サイズとSHA-256",
  placeAR: "テーブルか床に向けて、タップで配置します。", adjustAR: "ピンチで拡大縮小と回転、タップで移動します。",
};

const TABLES: Readonly<Record<Language, Words>> = { en: ENGLISH, de: GERMAN, ja: JAPANESE };

export const wordsOf = (element: HTMLElement): Words => TABLES[languageOf(element)];

/** What viewers are told of streams, in English with {} for what changes, and in the other languages. */
export const MESSAGES: Readonly<Record<string, readonly [german: string, japanese: string]>> = {
  "{}; trying again.": ["{}; neuer Versuch.", "{}。再試行しています。"],
  "{} Frames {} to {} are skipped.": ["{} Die Bilder {} bis {} werden übersprungen.", "{}フレーム{}から{}をスキップします。"],
  "The server cannot be reached.": ["Der Server ist nicht erreichbar.", "サーバーに接続できません。"],
  "The server does not respond.": ["Der Server antwortet nicht.", "サーバーが応答しません。"],
  "The connection was interrupted.": ["Die Verbindung wurde unterbrochen.", "接続が中断されました。"],
  "The connection timed out.": ["Die Verbindung brach wegen Zeitüberschreitung ab.", "接続がタイムアウトしました。"],
  "The connection ended early.": ["Die Verbindung endete zu früh.", "接続が途中で終了しました。"],
  "{} cannot be fetched: the server returned status {}.": ["{} ist nicht abrufbar: Der Server meldet Status {}.", "{}を取得できません: サーバーがステータス{}を返しました。"],
  "{} is damaged: its SHA-256 does not match the manifest.": ["{} ist beschädigt: SHA-256 passt nicht zum Manifest.", "{}は破損しています: SHA-256がマニフェストと一致しません。"],
  "The stream's manifest is damaged: {}": ["Das Manifest des Streams ist beschädigt: {}", "ストリームのマニフェストが破損しています: {}"],
  "There is no stream at this address: {}": ["Unter dieser Adresse ist kein Stream: {}", "このアドレスにストリームはありません: {}"],
  "The stream has format version {}; this player plays version {}.": ["Der Stream hat die Formatversion {}; dieser Player spielt Version {}.", "ストリームの形式はバージョン{}ですが、このプレーヤーはバージョン{}用です。"],
  "The stream plays without sound: {}": ["Der Stream läuft ohne Ton: {}", "音声なしで再生します: {}"],
  "This browser cannot play the stream's sound{}.": ["Dieser Browser kann den Ton des Streams nicht abspielen{}.", "このブラウザはストリームの音声を再生できません{}。"],
  "This browser decodes the video inexactly, so that it cannot be shown; another one may play it ({}).": ["Dieser Browser dekodiert das Video ungenau, sodass es nicht gezeigt werden kann; ein anderer spielt es vielleicht ({}).", "このブラウザは動画を正確に復号できないため、表示できません。別のブラウザでは再生できる場合があります ({})。"],
  "This browser cannot play the video ({}).": ["Dieser Browser kann das Video nicht abspielen ({}).", "このブラウザは動画を再生できません ({})。"],
  "This browser does not support WebGL2, which the player requires.": ["Dieser Browser unterstützt WebGL2 nicht, das der Player braucht.", "このブラウザは、プレーヤーに必要なWebGL2に対応していません。"],
  "The link is damaged: ignored its {}.": ["Der Link ist beschädigt, verworfen: {}.", "リンクが破損しています。無視した部分: {}"],
  "{} is damaged: {}.": ["{} ist beschädigt: {}.", "{}は破損しています: {}"],
};

/** A message about a stream in a language; as it is if nobody has translated it. */
export function inLanguage(message: string, language: Language): string {
  if (language === "en") return message;
  for (const [english, translated] of Object.entries(MESSAGES)) {
    const pattern = english.replace(/[.()]/g, "\\$&").replaceAll("{}", "(.*)");
    const found = new RegExp(`^${pattern}$`).exec(message);
    if (found === null) continue;
    const parts = found.slice(1).map((part) => inLanguage(part, language));
    return translated[language === "de" ? 0 : 1].replaceAll("{}", () => parts.shift()!);
  }
  // A part of a sentence was a sentence.
  return message === "" || message.endsWith(".") ? message : inLanguage(`${message}.`, language).replace(/[.。]$/, "");
}
