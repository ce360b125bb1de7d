// Installs an emulated headset as navigator.xr, over a room with a table whose top is 0.7 m high.
const { XRDevice, metaQuest3 } = IWER;
const TABLE = 0.7;

class Room {
  version = "0";
  environmentCanvas = document.createElement("canvas");
  trackedPlanes = new Set();
  trackedMeshes = new Set();
  render() {}
  // A ray's matrix is column-major and looks along -z.
  computeHitTestResults(ray) {
    const far = (TABLE - ray[13]) / -ray[9];
    if (!(far > 0 && far < 10)) return [];
    return [[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, ray[12] - far * ray[8], TABLE, ray[14] - far * ray[10], 1]];
  }
}

window.headset = new XRDevice(metaQuest3);
window.headset.stereoEnabled = true;
window.headset.installRuntime({ forceInstall: true });
window.headset.installSEM(Room);
