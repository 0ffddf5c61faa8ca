//! Organised point clouds as frames: points in rows and columns, each a distance.
//!
//! A depth camera's cloud is in its optical frame (REP-103: z forward; its `frame_id` ends with `optical_frame`), where the
//! distance is z, as in its depth image. In any other frame it is the distance from the origin, as a lidar measures.

use crate::MessageFault;
use crate::catalogue::Encoding;
use crate::counts::Unit;
use crate::frame_message::{FrameHead, quoted};
use crate::message::{PointCloud2Message, PointField, decode, stamp, unterminated};

/// How a coordinate is encoded: `PointField.FLOAT32`, `PointField.FLOAT64`.
const FLOAT32: u8 = 7;
const FLOAT64: u8 = 8;

/// Where a coordinate lies in a point, and whether it takes eight bytes.
#[derive(Clone, Copy)]
struct Coordinate {
    offset: usize,
    is_double: bool,
}

/// Reads a cloud's distances into `counts`, which is cleared first.
pub(crate) fn read_point_cloud(
    encoding: Encoding,
    data: &[u8],
    unit: Unit,
    counts: &mut Vec<u16>,
) -> Result<FrameHead, MessageFault> {
    let cloud: PointCloud2Message<'_, &[u8]> = decode(encoding, data)?;
    let (rows, columns) = (cloud.height, cloud.width);
    if rows == 0 || columns == 0 {
        return Err(MessageFault::NoReadings { rows, columns });
    }
    if rows == 1 {
        return Err(MessageFault::NotOrganised { n_points: columns });
    }
    let xyz = coordinates(&cloud)?;
    check_sizes(&cloud, xyz)?;
    let is_optical = unterminated(cloud.header.frame_id).ends_with(b"optical_frame");
    let is_big_endian = cloud.is_bigendian != 0;
    counts.clear();
    for row in cloud.data.chunks(cloud.row_step as usize).take(rows as usize) {
        for point in row.chunks(cloud.point_step as usize).take(columns as usize) {
            let [x, y, z] = xyz.map(|coordinate| coordinate.read(point, is_big_endian));
            let metres = if is_optical { z } else { (x * x + y * y + z * z).sqrt() };
            counts.push(unit.count_of_metres(metres as f32, u16::MAX));
        }
    }
    Ok(FrameHead { captured: stamp(&cloud.header), rows, columns })
}

fn coordinates(cloud: &PointCloud2Message<'_, &[u8]>) -> Result<[Coordinate; 3], MessageFault> {
    let find = |name: &[u8]| {
        let is_named = |field: &&PointField<&[u8]>| unterminated(field.name) == name;
        let field = cloud.fields.iter().find(is_named)?;
        let is_double = match field.datatype {
            FLOAT32 => false,
            FLOAT64 => true,
            _ => return None,
        };
        Some(Coordinate { offset: field.offset as usize, is_double })
    };
    match (find(b"x"), find(b"y"), find(b"z")) {
        (Some(x), Some(y), Some(z)) => Ok([x, y, z]),
        _ => {
            let names: Vec<String> =
                cloud.fields.iter().take(16).map(|field| quoted(unterminated(field.name))).collect();
            Err(MessageFault::NoCoordinates { fields: names.join(", ") })
        }
    }
}

fn check_sizes(cloud: &PointCloud2Message<'_, &[u8]>, xyz: [Coordinate; 3]) -> Result<(), MessageFault> {
    let &PointCloud2Message { height: rows, width: columns, point_step, row_step, .. } = cloud;
    let needed = xyz.map(|coordinate| coordinate.end() as u64).into_iter().max().unwrap_or(0);
    if u64::from(point_step) < needed {
        return Err(MessageFault::PointTooShort { point_step, needed });
    }
    let needed = u64::from(columns) * u64::from(point_step);
    if u64::from(row_step) < needed {
        return Err(MessageFault::RowTooShort {
            step: row_step,
            columns,
            bytes_per_pixel: point_step,
            needed,
        });
    }
    let needed = u64::from(rows) * u64::from(row_step);
    if (cloud.data.len() as u64) < needed {
        return Err(MessageFault::DataTooShort { n_bytes: cloud.data.len(), rows, step: row_step, needed });
    }
    Ok(())
}

impl Coordinate {
    /// The first byte of a point that is not needed for it.
    fn end(self) -> usize {
        self.offset + if self.is_double { 8 } else { 4 }
    }

    /// * `point` — as long as [`check_sizes`] asks for
    fn read(self, point: &[u8], is_big_endian: bool) -> f64 {
        let bytes = &point[self.offset..self.end()];
        match (bytes, is_big_endian) {
            (&[a, b, c, d], false) => f32::from_le_bytes([a, b, c, d]).into(),
            (&[a, b, c, d], true) => f32::from_be_bytes([a, b, c, d]).into(),
            (&[a, b, c, d, e, f, g, h], false) => f64::from_le_bytes([a, b, c, d, e, f, g, h]),
            (&[a, b, c, d, e, f, g, h], true) => f64::from_be_bytes([a, b, c, d, e, f, g, h]),
            _ => unreachable!("a coordinate has four or eight bytes"),
        }
    }
}
