// Writes a drive as MCAP with npm's @mcap/core and @foxglove/rosmsg2-serialization.
//   node write_mcap.cjs POINTS.json OUT.mcap        (NODE_PATH: folder with the packages)
const fs = require("fs");
const { McapWriter } = require("@mcap/core");
const { MessageWriter } = require("@foxglove/rosmsg2-serialization");
const { parse } = require("@foxglove/rosmsg");

const definition = `std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: sensor_msgs/PointField
string name
uint32 offset
uint8 datatype
uint32 count
`;

class File {
  constructor(path) {
    this.file = fs.openSync(path, "w");
    this.at = 0n;
  }
  async write(bytes) {
    fs.writeSync(this.file, bytes);
    this.at += BigInt(bytes.length);
  }
  position() {
    return this.at;
  }
}

async function main() {
  const drive = JSON.parse(fs.readFileSync(process.argv[2]));
  const serialiser = new MessageWriter(parse(definition, { ros2: true }));
  const writer = new McapWriter({ writable: new File(process.argv[3]), chunkSize: 100000 });
  await writer.start({ profile: "ros2", library: "test" });
  const schemaId = await writer.registerSchema({
    name: "sensor_msgs/msg/PointCloud2",
    encoding: "ros2msg",
    data: new TextEncoder().encode(definition),
  });
  const channelId = await writer.registerChannel({
    topic: "/points",
    schemaId,
    messageEncoding: "cdr",
    metadata: new Map(),
  });
  const names = ["x", "y", "z", "intensity", "t"];
  for (const [k, points] of drive.scans.entries()) {
    const stamp = drive.start_us + k * drive.step_us;
    const data = new DataView(new ArrayBuffer(points.length * 20));
    points.forEach((p, i) => {
      for (let c = 0; c < 4; ++c) data.setFloat32(20 * i + 4 * c, p[c], true);
      data.setUint32(20 * i + 16, p[4], true);
    });
    const message = {
      header: { stamp: { sec: Math.floor(stamp / 1e6), nanosec: (stamp % 1e6) * 1000 }, frame_id: "lidar" },
      height: 1,
      width: points.length,
      fields: names.map((name, i) => ({ name, offset: 4 * i, datatype: i < 4 ? 7 : 6, count: 1 })),
      is_bigendian: false,
      point_step: 20,
      row_step: 20 * points.length,
      data: new Uint8Array(data.buffer),
      is_dense: true,
    };
    const time = BigInt(stamp + 120000) * 1000n;
    await writer.addMessage({
      channelId,
      sequence: k,
      logTime: time,
      publishTime: time,
      data: serialiser.writeMessage(message),
    });
  }
  await writer.end();
}

main();
