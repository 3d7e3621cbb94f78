"""Which drives lie under a folder, told by how their folders look; the formats are those of README.md, "Data sets"."""
import dataclasses
import os
import pathlib
import re

HELIPR_SENSORS = ("Ouster", "Avia", "Aeva", "Velodyne")
DEEPEST = 7


@dataclasses.dataclass(frozen=True)
class Drive:
    """One drive: what goes on the command line, its format, and a name for people and files."""
    path: str
    format: str
    name: str

    @property
    def key(self):
        """The last folders of its path, which the paper's columns are matched with."""
        return "/".join(pathlib.PurePath(self.path).parts[-4:])


def _format_of(folder, entries):
    """(format, path) of each drive that `folder` is itself."""
    names = {entry.name for entry in entries if entry.is_dir()}
    if "velodyne_points" in names:
        return [("kitti-raw", folder)]
    if "LiDAR" in names:
        sensors = [s for s in HELIPR_SENSORS if os.path.isdir(os.path.join(folder, "LiDAR", s))]
        if sensors:
            return [("helipr", os.path.join(folder, "LiDAR", s)) for s in sensors]
    if "Ouster" in names:
        return [("mulran", folder)]
    if "pcds" in names:
        return [("apollo", folder)]
    if "velodyne" in names:
        try:
            with open(os.path.join(folder, "calib.txt"), encoding="utf-8", errors="replace") as file:
                has_tr = re.search(r"^Tr(_velo_to_cam)?:", file.read(65536), re.MULTILINE)
        except OSError:
            has_tr = None
        return [("kitti" if has_tr else "generic", folder)]
    return []


def _name(root, path, drive_format):
    """Short and unique under one root: format and the folders below it that say something."""
    relative = os.path.relpath(path, root)
    parts = [p for p in pathlib.PurePath(relative).parts if p not in (".", "..", "LiDAR", "sequences")]
    if not parts:
        parts = [p for p in pathlib.PurePath(path).parts if p not in ("LiDAR", "sequences")][-1:]
        if drive_format == "helipr":
            parts = [pathlib.PurePath(path).parts[-3], pathlib.PurePath(path).parts[-1]]
    return re.sub(r"[^A-Za-z0-9._-]+", "_", "_".join(parts))


def find(root):
    """Every drive under `root`, in order of path. `root` may be a drive itself, a bag or log, or synthetic:SCENE."""
    root = str(root)
    if root.startswith("synthetic:"):
        return [Drive(root, "synthetic", root.replace(":", "_"))]
    root = os.path.abspath(root)
    if os.path.isfile(root):
        return [Drive(root, "file", pathlib.PurePath(root).stem)]
    found = []

    def walk(folder, depth):
        try:
            entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
        except OSError:
            return
        drives = _format_of(folder, entries)
        found.extend(Drive(path, f, _name(root, path, f)) for f, path in drives)
        if drives or depth == DEEPEST:
            return
        for entry in entries:
            if entry.is_dir() and not entry.name.startswith("."):
                walk(entry.path, depth + 1)

    walk(root, 0)
    if not found:
        # A folder of scans, or a part of a drive (its sensor's folder): the player's own recognition decides.
        scans = any(e.name.lower().endswith((".bin", ".pcd", ".ply")) for e in os.scandir(root))
        parts = pathlib.PurePath(root).parts
        if scans and parts[-2:-1] == ("LiDAR",) and parts[-1] in HELIPR_SENSORS:
            return [Drive(root, "helipr", _name(root, root, "helipr"))]
        if scans:
            return [Drive(root, "generic", _name(root, root, "generic"))]
    return found


def in_column(drive, column):
    """Whether the drive belongs in this column of a table of the paper."""
    return re.search(column["drives"], drive.key, re.IGNORECASE) is not None
