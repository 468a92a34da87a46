"use strict";
globalThis.page = new Page(JSON.parse($("mission").textContent));
if (page.mission.live) page.follow();
