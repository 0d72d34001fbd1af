// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The numbers of the rules that no formula gives, one a statement, with unit and reason.
// docs/make_tuned.py halves and doubles those of the robust rule and prints what that changes;
// docs/engine.md shows it.
//
// g = sqrt(band / R) ties them to the cloud. The band is as deep as the dimples of a sheet of
// spacing 2 g R, or of a curve of spacing 2 sqrt(2) g R, and the nearest sample then lies at most
// sqrt(2) g R beside the foot.
#pragma once

#include "vfplan/base/compiler.hpp"

namespace vfplan::inline v1::tuned {

/// Radius of the fit, in spacings of a cloud whose dimples are as deep as the band. A quadric needs
/// the second ring of samples, and bends away from what is further away.
inline constexpr double fit_spacings = 2.2;

/// Largest radius of the fit, in R. It holds three samples a side at the coarsest spacing that
/// holds the proxy back, which is R.
inline constexpr double max_fit_radius = 1.7;

/// How far a fitted normal may tilt from the mean direction of its points, as a multiple of the
/// sine sqrt(2) g that sampling alone explains. With less, the mean leads and the proxy cogs from
/// sample to sample; with more, a rim is taken for a surface.
inline constexpr double max_tilt = 1.3;

/// How far the centre of the samples may lie from the foot if they surround it, in radii of the
/// fit. At a straight border the weights' integrals give 0.29 (sheet) or 0.31 (curve).
inline constexpr double surrounded_offset = 0.18;

/// From where on they lie on one side, in radii of the fit. With 0.25 edges would be found sharper,
/// but among thick pixels the proxy is then held back (tests/engine/test_rests.py, the mask).
inline constexpr double one_sided_offset = 0.38;

/// Share of the weights that a slope has to beat, so that it counts only if the points show it.
inline constexpr double slope_ridge = 1e-7;

/// The same of a curvature, which counts only if the points need it.
inline constexpr double curvature_ridge = 1e-4;

/// Angle between two directions of one surface, in g. It spans three spacings, so that a missing
/// sample does not part a surface. As a sine between path and sphere it is also where a sphere of
/// radius R stops a sweep: those of the surface that the proxy slides on are met under sines of up
/// to 3 g.
inline constexpr double same_surface_angle = 6;

/// Largest such angle [rad]: the walls of a corner of up to 128 degrees stay two. Half of it is the
/// largest sine of a tilt and of the meeting with a sphere, for what is steeper is the other wall.
inline constexpr double max_same_surface_angle = 0.9;

/// Reach of the list of neighbours beyond R, in R: what short sweeps need. Three quarters of it is
/// how far the proxy goes before the list is gathered anew, twice of it the side of a grid's cell.
/// It costs or saves time and changes no answer.
inline constexpr double list_margin = 0.2;

/// Length below which a step is none, in bands. Rest is held to it.
inline constexpr double min_step = 1e-2;

/// Margin of a sweep before R - b, of a tick before |proxy - HIP| grows, and the distance within
/// which a HIP counts as not moved; in bands. Two such steps change a gain by at most four times as
/// much, which is less than `min_step`: no step gains by noise.
inline constexpr double gain_margin = 1e-3;

/// By how much a step may miss a plane through rounding, in bands.
inline constexpr double plane_slack = 1e-6;

/// By how much a sweep ends before the sphere that it meets, in R: far more than a rounding of R.
inline constexpr double stop_before = 1e-9;

/// Number of ticks in which the HIP has not moved, from where on only a gain counts.
inline constexpr int ticks_to_stall = 32;

/// Bands that count as sinking. No contact is further away than this and no lift is longer. Between
/// several surfaces the points among which the proxy squeezes must give more. The lifts below one
/// place of the HIP may take the proxy away by no more, until it has come nearer by a band.
inline constexpr double max_lift_bands = 2;

/// Smallest 1 + h kappa of a hollow. In one that is nearly as narrow as the proxy the foot is
/// anywhere.
inline constexpr double narrowest_hollow = 0.2;

/// How much the force may change in a millisecond after a start inside, an exchange or an edit,
/// besides following the HIP: K times this share of R.
inline constexpr double force_ramp = 0.00390625;  // 1/256

/// The most that the force changes after an exchange, an edit or another K, whatever K is [N/s]: a
/// newton in a millisecond is what arms take.
inline constexpr double max_force_ramp = 1000;

/// How long the force of before lasts after an exchange where nothing is in reach now [s].
inline constexpr double release_time = 0.09;

// The five margins that follow are far above what float64 rounds and far below what is felt. Ten
// times as much, or a tenth, changes no bit of the scenes of tests/native/engine_bits.cpp; of
// hop_margin, the last digits of a way out of triangles.

/// Sine of the angle under which a direction may lead into a line or an arc and still counts as
/// along it. A unit vector is rounded to 2e-16.
inline constexpr double along_sine = 1e-9;

/// What a HIP has to lie behind the tangent at a proxy so that it presses: as a share of R and the
/// distance from the proxy to the HIP.
inline constexpr double pressing_share = 1e-12;

/// How much nearer than R a start has to be so that it is inside, in R. What comes out at R is not
/// led out once more.
inline constexpr double inside_margin = 1e-9;

/// How much further than R the nearest geometry is looked for, in R, so that a rounding does not
/// hide what lies at R.
inline constexpr double reach_margin = 1e-6;

/// How far a way out goes beyond the place where it comes out, in R, so that the next look there
/// does not find the same place again.
inline constexpr double hop_margin = 1e-12;

/// What a path of rule exact may sink by rounding at its start, in bands, before it counts as
/// meeting something. Halved or doubled it changes bits among crossing lines alone, and nothing
/// else in those scenes.
inline constexpr double start_slack = 1e-3;

/// How far rule exact may sink in all, in bands. The rest of the band is for the roundings of the
/// check that follows. Halved it changes no bit.
inline constexpr double max_sink = 0.75;

/// Room that the proxy has in a hollow arc which counts as full, in bands: its places are too near
/// to each other to be told apart. Halved or doubled it changes no bit.
inline constexpr double full_hollow = 0.1;

}  // namespace vfplan::inline v1::tuned
