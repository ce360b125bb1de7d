import { Player } from "./player/player.ts";
(globalThis as unknown as Record<string, unknown>)["V3Player"] = Player;
