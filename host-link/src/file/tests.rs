//! Inputs are bounded; outputs are whole or not there.

use super::*;
use std::os::unix::fs::{PermissionsExt, chown, symlink};

fn names(folder: &Path) -> Vec<String> {
    let name = |entry: std::io::Result<fs::DirEntry>| entry.unwrap().file_name();
    let mut names: Vec<_> = fs::read_dir(folder).unwrap().map(name).collect();
    names.sort();
    let text = |name: &std::ffi::OsString| name.to_string_lossy().into();
    names.iter().map(text).collect()
}

// Requirement: WIRE-program-1
#[test]
fn save_device_link_folder_or_foreign_file_is_refused() {
    let here = tempfile::tempdir().unwrap();
    let here = here.path();
    let (foreign, link, folder) = (here.join("foreign"), here.join("link"), here.join("folder"));
    fs::write(&foreign, "a letter").unwrap();
    symlink(&foreign, &link).unwrap();
    fs::create_dir(&folder).unwrap();
    // Links are not followed, even where nothing foreign is at their ends.
    let (picture, dangling) = (here.join("picture"), here.join("dangling"));
    symlink(here.join("nothing"), &dangling).unwrap();
    let own = here.join("own.png");
    fs::write(&own, b"\x89PNG\r\n\x1a\n").unwrap();
    symlink(&own, &picture).unwrap();
    let socket = here.join("socket");
    let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    let before = names(here);
    let inside = here.join("foreign/x");
    for path in [
        &foreign, &link, &picture, &dangling, &folder, &socket, &inside,
    ] {
        let refused = save(path, Kind::Png, b"\x89PNG\r\n\x1a\n");
        assert!(matches!(refused, Err(Error::Unwritable { .. })), "{path:?}");
        assert!(check(path, Kind::Png).is_err());
    }
    assert_eq!(fs::read(&foreign).unwrap(), b"a letter");
    assert_eq!(names(here), before);
    save(&foreign, Kind::Any, b"replaced").unwrap();
    assert_eq!(fs::read(&link).unwrap(), b"replaced");
}

// Requirement: WIRE-program-1
#[test]
fn save_replaces_its_kind_and_follows_no_planted_link() {
    let here = tempfile::tempdir().unwrap();
    let here = here.path();
    let (map, victim) = (here.join("map.pgm"), here.join("victim"));
    fs::write(&victim, "kept").unwrap();
    symlink(&victim, here.join(".map.pgm.robot-new")).unwrap();
    for bytes in [b"P5\n1", b"P5\n2"] {
        save(&map, Kind::Pgm, bytes).unwrap();
        assert_eq!(fs::read(&map).unwrap(), bytes);
    }
    check(&map, Kind::Pgm).unwrap();
    assert_eq!(fs::read(&victim).unwrap(), b"kept");
    assert_eq!(names(here), ["map.pgm", "victim"]);
    let token = here.join("token");
    save(&token, Kind::Token, b"secret").unwrap();
    assert_eq!(fs::metadata(&token).unwrap().mode() & 0o077, 0);
}

#[test]
fn image_is_recognised_by_key_or_unwritten_cells() {
    let here = tempfile::tempdir().unwrap();
    let here = here.path();
    let path = here.join("image.bin");
    let is_replaced = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        assert_eq!(read(&path, bytes.len() as u64).unwrap(), bytes);
        assert!(read(&path, bytes.len() as u64 - 1).is_err());
        check(&path, Kind::Image).is_ok()
    };
    let unwritten = |len: usize, cells: std::ops::Range<usize>| {
        let mut bytes = vec![0; len];
        bytes[cells].fill(0xFF);
        bytes
    };
    assert!(is_replaced(&unwritten(ORIGINAL_LEN, 0xF0..0x100)));
    for cells in [0xF1..0x100, 0xF0..0xFF] {
        assert!(!is_replaced(&unwritten(ORIGINAL_LEN, cells)));
    }
    for (len, is_image) in [
        (ORIGINAL_LEN - 1, false),
        (ORIGINAL_LEN, true),
        (LARGEST_LEN, true),
        (LARGEST_LEN + 1, false),
    ] {
        let mut keyed = vec![0; len];
        keyed[..KEY.len()].copy_from_slice(&KEY);
        assert_eq!(is_replaced(&keyed), is_image, "{len}");
        assert_eq!(is_replaced(&unwritten(len, 0xF0..0x100)), is_image, "{len}");
    }
}

#[test]
fn log_is_replaced_whatever_its_first_line_reports() {
    let here = tempfile::tempdir().unwrap();
    let path = here.path().join("stm.log");
    for (first, is_log) in [("I0", true), ("W0", true), ("E0", true), ("D0", false)] {
        fs::write(&path, first.to_owned() + "0000: line\n").unwrap();
        assert_eq!(check(&path, Kind::Log).is_ok(), is_log, "{first}");
    }
}

#[test]
fn file_is_replaced_by_its_own_kind_alone() {
    let here = tempfile::tempdir().unwrap();
    let path = here.path().join("output");
    let files: [(_, &[u8]); 5] = [
        (Kind::Pgm, b"P5\n4 4\n"),
        (Kind::MapYaml, b"image: map.pgm\n"),
        (Kind::Samples, b"seconds,percent,mm\n"),
        (Kind::Json, b"{}\n"),
        (Kind::Recording, b"\x89MCAP0\r\n"),
    ];
    for (present, bytes) in files {
        fs::write(&path, bytes).unwrap();
        for (kind, _) in files {
            assert_eq!(check(&path, kind).is_ok(), kind == present, "{kind:?}");
        }
    }
}

#[test]
fn suffix_is_added_to_whole_name_and_bare_name_lies_here() {
    assert_eq!(with_suffix(Path::new("b/a.x"), ".y"), Path::new("b/a.x.y"));
    assert_eq!(folder(Path::new("b/a.x")), Path::new("b"));
    assert_eq!(folder(Path::new("a.x")), Path::new("."));
}

#[test]
fn text_that_is_not_utf_8_is_refused() {
    let here = tempfile::tempdir().unwrap();
    let path = here.path().join("a.toml");
    fs::write(&path, b"mode = \"\xFF\"").unwrap();
    assert!(matches!(read_text(&path), Err(Error::Content { .. })));
    fs::write(&path, "\u{FEFF}mode").unwrap();
    assert_eq!(read_text(&path).as_deref(), Ok("mode"));
}

#[test]
fn read_endless_device_is_refused() {
    for refused in [
        read(Path::new("/dev/zero"), 1 << 16),
        read_text(Path::new("/dev/zero")).map(String::into),
    ] {
        let error = refused.unwrap_err().to_string();
        assert!(error.contains("/dev/zero: it has more than"), "{error}");
    }
}

#[test]
fn fault_shows_line_and_caret() {
    let text = "one\n\tç = bad # no\n";
    let at = text.find("bad").unwrap();
    let fault = FileFault::at(text, at..at + 3, "accepted is good");
    let expected = "f.toml, line 2: accepted is good\n    \tç = bad # no\n    \t    ^^^";
    assert_eq!(fault.describe(Path::new("f.toml")), expected);
    let end = FileFault::at(text, text.len()..text.len() + 9, "cut");
    assert_eq!(end.line, Some(3));
}

#[test]
fn kept_file_of_another_user_is_trusted_in_a_folder_of_few_only() {
    let here = tempfile::tempdir().unwrap();
    let [kept, link, none] = ["kept", "link", "none"].map(|name| here.path().join(name));
    fs::write(&kept, "x").unwrap();
    symlink(&kept, &link).unwrap();
    let rights = |mode| fs::set_permissions(here.path(), fs::Permissions::from_mode(mode)).unwrap();
    let replaces = |other: bool| {
        let [file, folder] = [&kept, here.path()].map(|path| fs::metadata(path).unwrap());
        may_replace(file.uid() + u32::from(other), &file, &folder)
    };
    assert!(replaces(true));
    rights(0o1777);
    assert!(replaces(false) && !replaces(true));
    ensure_trusted(&kept).unwrap();
    for wrong in [&link, here.path(), &none] {
        assert!(ensure_trusted(wrong).is_err(), "{}", wrong.display());
    }
    // Only root can give it away.
    if chown(&kept, Some(12_345), None).is_ok() {
        let why = ensure_trusted(&kept).unwrap_err().to_string();
        assert!(why.contains("another user's"), "{why}");
        rights(0o2770);
        ensure_trusted(&kept).unwrap();
    }
}
