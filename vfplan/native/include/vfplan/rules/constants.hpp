// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The numbers of the robust rule that no formula gives, each with its reason. docs/make_tuned.py
// varies them one by one and prints what each change does; docs/engine.md has the table.
//
// g = sqrt(band / R) ties them to the cloud: the band is as deep as the dimples of a sheet of
// spacing 2 g R, or of a curve of spacing 2 sqrt(2) g R, and the nearest sample then lies at most
// sqrt(2) g R beside the foot.
#pragma once

namespace vfplan::tuned {

/// Radius of the fit in such spacings. A quadric needs the second ring of samples, and bends away
/// from what is further off.
inline constexpr double window = 2.2;
/// ... in R at most: wide enough for three samples a side at the coarsest spacing that holds, R.
inline constexpr double widest_window = 1.7;

/// How far a fitted normal may lean from the mean direction of the contacts, in the sine sqrt(2) g
/// that sampling alone explains. Less: the normal of the mean leads, with its cogging; more: a rim
/// is taken for a surface.
inline constexpr double lean = 1.3;

/// How far the centre of the samples lies from the foot, in radii of the fit, up to which they
/// surround it, and from where on they do not. At a straight border it is 0.29 (sheet) or 0.31
/// (curve), by the weights' integrals. Up to 0.25 alone would find edges sharper, but among thick
/// pixels holds the proxy back (test_rests.py, the sample's mask).
inline constexpr double surrounded = 0.18, one_sided = 0.38;

/// Directions of contacts that differ by less than this, in g, belong to one surface: three
/// spacings, so that a missing sample does not part it. As a sine between way and sphere it is
/// where a sphere of radius R stops a sweep: those of the surface that the proxy slides on are met
/// under sines up to 3 g.
inline constexpr double linked = 6;
/// ... as an angle at most: walls of a corner of up to 128 degrees stay two. Its half is the
/// largest sine of a lean and of a sphere's meeting, for what is steeper is the other wall.
inline constexpr double most_linked = 0.9;

/// Of R: reach of the list of neighbours, that the brief sweeps need; three quarters of it: how far
/// the proxy goes before it is gathered anew; twice: the side of a grid's cell. It costs or saves
/// time, and changes no answer.
inline constexpr double brief = 0.2;

/// Of the band: a step below it is none; rest is held to it.
inline constexpr double min_advance = 1e-2;
/// Of the band: margin of a sweep before R - band, and of a tick before it lets |proxy - HIP| grow;
/// and how far from where patience began a HIP counts as not moved. Two such ways change what a
/// step gains by four times as much at most, less than `min_advance`: no step gains by noise.
inline constexpr double margin = 1e-3;
/// Of the band: by how much a step may miss a wall through rounding.
inline constexpr double slack = 1e-6;
/// Of R: by how much a sweep ends before the sphere that it met, far more than a rounding of R.
inline constexpr double hair = 1e-9;
/// Ticks that the HIP has not moved from where on only a gain counts.
inline constexpr int patience = 32;
/// Bands that count as sinking: no contact is further off than this, no lift is longer, between
/// several walls the points among which it squeezes must give more, and lifts below one place of
/// the HIP may take the proxy away by no more, until it has come nearer by a band.
inline constexpr double deep = 2;

/// Least 1 + h kappa of a hollow: in one nearly as narrow as the proxy the foot is anywhere.
inline constexpr double narrowest = 0.2;

}  // namespace vfplan::tuned
