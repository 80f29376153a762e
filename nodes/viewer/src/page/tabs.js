// The tabs below the images: one of them is open, and the part of the address behind # names it.

import { byId } from "./dom.js";

const tabs = [...byId("tabs").children];
const openOne = () => tabs.find(({ hash }) => hash === location.hash) ?? tabs[0];

// Shows the open tab alone, and returns its name.
export function drawTabs() {
  const open = openOne();
  for (const tab of tabs) {
    tab.setAttribute("aria-selected", String(tab === open));
    tab.tabIndex = tab === open ? 0 : -1;
    byId(`${tab.hash.slice(1)}-panel`).hidden = tab !== open;
  }
  return open.hash.slice(1);
}

export function openTab(name) {
  location.hash = name;
  drawTabs();
}

byId("tabs").onkeydown = ({ key }) => {
  const by = { ArrowLeft: -1, ArrowRight: 1 }[key];
  if (!by) return;
  openTab(tabs.at((tabs.indexOf(openOne()) + by) % tabs.length).hash);
  openOne().focus();
};
