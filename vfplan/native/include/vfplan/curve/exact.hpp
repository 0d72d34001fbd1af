// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Rule `exact` for lines and arcs, not for samples of them. The hand moves the HIP (haptic
// interface point), which is where the tool is, and the proxy follows it in the plane of the curve
// as far as the curve lets it. The numbers in brackets, as (E1), are the equations of
// docs/exact.md.
//
//     R         distance from the curve at which the proxy rests on it [m]
//     b         the band, 1e-7 R for most curves: roundings may let the proxy sink by it [m]
//     piece     a line, or an arc of a quarter circle at most
//     feature   what the proxy can touch: the SIDE of a piece, which is the piece without its two
//               ends, or a JOINT, which is the end of one piece or the place where two meet. The
//               normals at the ends of a piece part the places that face its side from those that
//               face a joint
//     d, G(y)   distance of the place y from a feature, and a quadratic of the coordinates that
//               tells whether d is less than R. Of a side, d is above 0 to the right of a line and
//               outside of an arc, and G = d + kappa d^2 / 2 with the arc's curvature kappa; of a
//               joint G = d^2 / 2. A feature forbids the places with lower < G < upper (E5)
//     path      a line or a circle that starts at the proxy. Its parameter t is the length on a
//               line, and a little more than that on a circle (E1)
//
// The positions R away from a line or an arc are again lines and arcs. So the proxy moves freely
// until it meets a feature, and then slides along a path of one curvature. That path ends where the
// proxy is nearest to the HIP (E2), has it in sight (E3), comes to the end of the feature (E4), or
// meets another one (E5). Each of these places is the root of a quadratic. A path is taken only if
// it brings the proxy nearer to the HIP (E6).
//
// Feature, ArcPath and these equations stand in curve/offset.hpp. A feature *faces* the places
// between the normals at its ends, and its distance from any other place counts as infinite.
// GuardedRule (rules/rule.hpp) begins a tick with a proxy that is outside, and undoes it where it
// would end inside.
#pragma once

#include "vfplan/base/bounds_tree.hpp"
#include "vfplan/curve/offset.hpp"
#include "vfplan/curve/pieces.hpp"
#include "vfplan/rules/rule.hpp"

namespace vfplan::inline v1::curve {

/// Stands for the number of a feature where there is none.
inline constexpr int none = -1;

/// A curve of lines and arcs in a plane: its features in drawing order, and a tree of boxes around
/// them that finds those near a place.
class Curve {
  public:
    /// Inner steps that it takes to find one of the nearest features and to look at it.
    static constexpr int steps_an_item = 4;

    /// `strokes`: lines and arcs from vertex to vertex, in space. `plane`: what they are projected
    /// into, along the ignored axis. `radius`: R of the proxy that is to go round the curve [m].
    Curve(const std::vector<Stroke>& strokes, const Slice& plane, double radius) : R_(radius) {
        for (const Stroke& stroke : strokes) {
            std::vector<Vec2> corners(stroke.bulges.size());
            for (std::size_t i = 0; i < corners.size(); ++i)
                corners[i] = plane.project(point_at(stroke.vertices.data(), i));
            add(corners, stroke);
        }
        tree_.build(features_.size(), [this](std::size_t i) { return features_[i].box; });
    }

    const Feature& operator[](std::size_t i) const noexcept { return features_[i]; }
    std::size_t size() const noexcept { return features_.size(); }
    const BoundsTree<Box<2>>& tree() const noexcept { return tree_; }
    std::size_t bytes() const noexcept {
        return features_.capacity() * sizeof(Feature) + tree_.bytes();
    }

    /// What this tick may still do, in inner steps: each takes the time CurveMotion::a_step. What a
    /// look at the tree costs is returned by BoundsTree::visit, and every other cost stands where
    /// it is spent.
    WorkBudget& budget() const noexcept { return budget_; }

    /// Distance of y from the curve, or `reach` where that is less [m].
    double distance(const Vec2& y, double reach = infinity,
                    WorkBudget* budget = nullptr) const noexcept {
        const auto look = [&](std::uint32_t i) noexcept {
            budget_.spend(steps_an_item);
            reach = std::min(reach, features_[i].distance(y));
        };
        tree_.visit_nearest(y, reach, look, budget);
        return budget && budget->is_spent() ? 0 : reach;
    }

  private:
    /// Adds the features of a stroke. Each knows the number of the feature before and behind it.
    void add(const std::vector<Vec2>& corners, const Stroke& stroke) {
        const std::size_t n = corners.size();
        std::vector<PlanarPiece> pieces;
        for (std::size_t i = 0; i + (stroke.closed ? 0 : 1) < n; ++i)
            cut_into_quarters(corners[i], corners[(i + 1) % n], stroke.bulges[i], pieces);
        const int first_feature = static_cast<int>(features_.size());
        if (pieces.empty()) {  // a dot
            features_.push_back(joint(corners[0]));
            return;
        }
        // A joint, a side, a joint, a side, ...: an open stroke ends with a joint, and of a closed
        // one the last side leads back to the first joint.
        int at = first_feature;
        for (const PlanarPiece& piece : pieces) {
            features_.push_back(joint(piece.a));
            features_.back().ends[1] = {piece.a, piece.start_tangent, at + 1};
            features_.push_back(side(piece, at, at + 2));
            at += 2;
        }
        if (stroke.closed)
            features_.back().ends[1].next = first_feature;
        else
            features_.push_back(joint(pieces.back().b));
        // The other end of each joint: there the side of the piece before it takes over.
        for (int last = first_feature + 1; last < at; last += 2) {
            const EndNormal& end = (*this)[last].ends[1];
            features_[end.next].ends[0] = {end.at, -1.0 * end.outwards, last};
        }
    }

    /// A joint forbids G < R^2 / 2, which is d < R. (E5)
    Feature joint(const Vec2& at) const noexcept {
        Feature f;
        f.base = at;
        f.box = {at, at};
        f.kappa = 1;
        f.upper = R_ * R_ / 2;
        f.upper_slope = R_;
        for (EndNormal& end : f.ends) end.at = at;
        return f;
    }
    /// A side forbids what lies between the values of G at d = -R and at d = R (E5). An arc of
    /// radius R or less leaves no room in its hollow, which is then forbidden as a whole: `lower`
    /// stays at minus infinity. `before` and `behind` are the numbers of the joints at its ends.
    Feature side(const PlanarPiece& p, int before, int behind) const noexcept {
        Feature f;
        f.base = p.a;
        f.kappa = std::abs(p.kappa);
        f.n = (p.kappa < 0 ? -1.0 : 1.0) * left(p.start_tangent);
        f.upper = R_ + f.kappa * R_ * R_ / 2;
        f.upper_slope = 1 + f.kappa * R_;
        if (f.kappa * R_ < 1) {
            f.lower = -R_ + f.kappa * R_ * R_ / 2;
            f.lower_slope = 1 - f.kappa * R_;
        }
        f.ends[0] = {p.a, -1.0 * p.start_tangent, before};
        f.ends[1] = {p.b, p.end_tangent, behind};
        // The arc lies in the triangle of its chord and the tangents at its ends.
        const double chord = norm(p.b - p.a);
        const double cosine = dot(p.start_tangent, (1 / chord) * (p.b - p.a));
        const Vec2 tip = p.a + (chord / (2 * cosine)) * p.start_tangent;
        for (const Vec2& corner : {p.a, p.b, tip}) f.box.include(corner);
        return f;
    }

    double R_ = 0;  // of the proxy [m]
    std::vector<Feature> features_;
    BoundsTree<Box<2>> tree_;
    mutable WorkBudget budget_;
};

/// What a path meets first: where, and which feature.
///
/// A path that starts R from a feature, as along the one that the proxy slid along before, would
/// meet it at once by a rounding. So it meets that feature only where it has sunk by the start
/// slack, b / 1000 (constants.hpp). `is_touching` says that the path met its feature in this way.
struct FeatureHit : Entry {
    /// Lengths of the start slack. A path that touches and leads in under a slope of 1e-4 has sunk
    /// by one slack after 1e4 of them: it counts as blocked from its start. A flatter one goes on.
    static constexpr double slacks_to_sink = 1e4;

    int feature = none;  ///< its number

    /// Whether the feature is met where the path starts already, so that the proxy cannot move.
    bool is_immediate(const RoundingLimits& limits) const noexcept {
        return t < (is_touching ? slacks_to_sink : 1) * limits.start_slack;
    }
};

/// The direction along a feature that leads nearer to the HIP. `normal` leads from the feature to
/// the proxy, and `to_hip` from the proxy to the HIP.
inline Vec2 tangent_towards(const Vec2& normal, const Vec2& to_hip) noexcept {
    const Vec2 tangent = left(normal);
    return dot(tangent, to_hip) < 0 ? -1.0 * tangent : tangent;
}

/// The path of a proxy at x that slides along the feature of a contact: what lies as far from the
/// feature as x, a line or a circle, from x on in the direction `tangent`. A contact's curvature is
/// above 0 where the path goes round the feature, below 0 in a hollow, and 0 beside a line. (E1)
inline ArcPath offset_path(const Vec2& x, const Vec2& tangent,
                           const FeatureContact& contact) noexcept {
    const bool curves_right = dot(left(tangent), contact.normal) < 0;
    return {x, tangent, (curves_right ? contact.curvature : -contact.curvature) / 2};
}

/// Whether the proxy fills the hollow of an arc as wide as itself, so that the arc pushes it from
/// all its directions at once. What lies R from the arc, on its hollow side, is then a circle with
/// a radius below `full_hollow`, b / 10: its places are too near to each other to be told apart.
inline bool is_full_hollow(const FeatureContact& contact, const RoundingLimits& limits) noexcept {
    return -contact.curvature * limits.full_hollow > 1;
}

/// How the rule moves a proxy that is outside. `move_freely_and_slide` has the parts of a tick in
/// their order.
class CurveMotion {
  public:
    static constexpr int dimension = 2;
    /// A proxy at rest stays there as long as the HIP does not move, so a tick with an unmoved HIP
    /// gives the last answer again.
    static constexpr bool rest_is_final = true;
    /// The part of a path that is looked at first [R].
    static constexpr double first_part = 0.1;
    /// Inner steps that it takes to find where a path meets a feature.
    static constexpr int steps_a_try = 10;
    /// Iterations of a tick, each of which moves the proxy freely or along one feature.
    static constexpr int max_iterations = 32;
    /// Inner steps that a slide takes for each feature that it tries.
    static constexpr int steps_a_slide = 30;
    /// Inner steps after which a tick stops: half of max_tick_time.
    static constexpr int max_steps = 30000;
    /// Time of an inner step [s], on the machine of docs/engine.md.
    static constexpr double a_step = 5e-9;
    /// How far away the features lie that an iteration looks at [R]: on the first part of a path
    /// and around where it ends.
    static constexpr double list_reach = 1 + 2 * first_part;

    CurveMotion(Curve curve, const Parameters& p)
        : curve_(std::move(curve)),
          // Three lengths, of which rules/constants.hpp gives the reasons: b / 1000, 3 b / 4 and
          // b / 10.
          limits_{.start_slack = tuned::start_slack * p.band,
                  .max_sink = tuned::max_sink * p.band,
                  .full_hollow = tuned::full_hollow * p.band},
          R_(p.R()),
          band_(p.band),
          neighbourhood_(p.outer_radius + p.point_radius) {}

    std::size_t bytes() const noexcept { return curve_.bytes(); }
    std::size_t cells() const noexcept { return curve_.tree().size(); }
    double distance(const Vec2& x, double reach, WorkBudget* budget) const noexcept {
        return curve_.distance(x, reach, budget);
    }

    // GuardedRule asks every motion for what follows, down to `contact`.

    void begin_tick() noexcept { curve_.budget().begin(max_steps); }
    /// The proxy is put elsewhere: it touches nothing that is known.
    void release() noexcept { current_ = none; }
    void reset() noexcept { release(); }
    /// Only a proxy that is stalled is asked for the iterations of its last motion, and this rule
    /// has none: each of its iterations brings the proxy nearer to the HIP (E6).
    int iterations() const noexcept { return max_iterations; }
    bool is_spent() const noexcept { return curve_.budget().is_spent(); }

    /// Whether a proxy that may be anywhere is outside. The distance is kept for `contact`, which
    /// asks no further than its neighbourhood: in the middle of a circle all is equally far.
    bool is_outside(const Vec2& proxy, bool = false) noexcept {
        distance_ = curve_.distance(proxy, neighbourhood_);
        return distance_ >= R_ - band_;
    }

    /// Moves the proxy towards the HIP.
    MotionEnd move(Vec2& proxy, const Vec2& hip, StallTest<2>&, PlannedPath<2>&) noexcept {
        return move_within(nullptr, proxy, hip);
    }
    /// As `move`, but no further than to the edge of the ball. The proxy moves so while it is
    /// handed over to the rule after a start inside, because the force may change only slowly.
    /// ((W3) of docs/robust.md)
    MotionEnd move_within(const ForceBall<2>* ball, Vec2& proxy, const Vec2& hip) noexcept {
        outcome_ = move_freely_and_slide(proxy, hip, ball);
        if (outcome_ == Outcome::limit) return MotionEnd::limit;
        return outcome_ == Outcome::force_ball ? MotionEnd::force_ball : MotionEnd::rests;
    }

    /// Which state the proxy is in, and the direction in which the curve pushes it. GuardedRule has
    /// asked `is_outside` for the same place just before.
    RuleAnswer<2> contact(const Vec2& proxy, const Vec2& hip) noexcept {
        RuleAnswer<2> answer;
        if (distance_ <= R_ + band_) {
            answer.state = State::in_contact;
            // Where it is not one feature that holds the proxy, the spring tells the direction.
            const bool is_held_by_one = current_ != none && outcome_ != Outcome::corner;
            answer.normal =
                is_held_by_one ? curve_[current_].contact(proxy).normal : along(proxy - hip, 1);
        } else if (distance_ < neighbourhood_) {
            answer.state = State::free_motion;
        }
        return answer;
    }

    // What WayOut (rules/start_inside.hpp) asks of what a start may be inside of: all that lies
    // nearer to the curve than R.

    /// Unit vector from the nearest place of the curve to x; 0 where x lies on it, or further than
    /// R.
    Vec2 from_nearest(const Vec2& x) const noexcept {
        const double reach = R_ * (1 + tuned::reach_margin);
        double nearest = reach;
        Vec2 away;
        curve_.budget().spend(curve_.tree().around(x, reach, [&](std::uint32_t i) noexcept {
            const double d = curve_[i].distance(x);
            if (!(d < nearest && d > 0)) return;
            nearest = d;
            away = curve_[i].contact(x).normal;
        }));
        return away;
    }
    /// Distance from y along the unit vector `direction` out of all features that y is inside of;
    /// minus infinity where it is inside of none, and 0 where this tick may look no further.
    double exit_distance(const Vec2& y, const Vec2& direction) const noexcept {
        if (curve_.budget().is_spent()) return 0;
        const ArcPath path(y, direction, 0);
        double distance = -infinity;
        curve_.budget().spend(curve_.tree().around(y, R_, [&](std::uint32_t i) noexcept {
            if (curve_[i].distance(y) < R_ * (1 - tuned::inside_margin))
                distance = std::max(distance, curve_[i].exit_parameter(path));
        }));
        return distance;
    }
    /// A curve is the skin of no body.
    std::optional<bool> is_in_body(const Vec2&, double) const noexcept { return false; }

  private:
    /// The features that touch the proxy where it stands, each of which may hold it from sliding
    /// along the others.
    struct HoldingFeatures {
        static constexpr int max_features = 6;

        int feature[max_features];
        FeatureContact contact[max_features];
        int count = 0;

        /// Adds a feature, with how it touches a proxy at x. False where it is there already, or
        /// there are too many. A hollow that the proxy fills pushes as its two ends do, so these
        /// are added instead.
        bool add(const CurveMotion& motion, int added, const Vec2& x) noexcept {
            for (int j = 0; j < count; ++j)
                if (feature[j] == added) return false;
            const FeatureContact touch = motion.curve_[added].contact(x);
            if (is_full_hollow(touch, motion.limits_)) {
                const EndNormal* ends = motion.curve_[added].ends;
                const bool first = add(motion, ends[0].next, x);
                const bool second = add(motion, ends[1].next, x);
                return first || second;
            }
            if (count == max_features) return false;
            feature[count] = added;
            contact[count] = touch;
            ++count;
            return true;
        }
        /// The index, into the two arrays, of the feature along which a step leads nearer to the
        /// HIP and into none of the others. Of several it is the one that was met last. `none`
        /// where there is no such feature.
        int open_towards(const Vec2& to_hip) const noexcept {
            for (int i = count - 1; i >= 0; --i) {
                const Vec2 tangent = tangent_towards(contact[i].normal, to_hip);
                bool is_open = dot(tangent, to_hip) > 0;
                for (int j = 0; j < count && is_open; ++j)
                    is_open = j == i || dot(tangent, contact[j].normal) > -tuned::along_sine;
                if (is_open) return i;
            }
            return none;
        }
    };

    /// How a part of the motion ended.
    enum class Outcome {
        rests,       ///< at the HIP, or on one feature, where nothing leads nearer to the HIP
        corner,      ///< the same, held by several features
        goes_on,     ///< another part follows, free or along a feature
        blocked,     ///< by the feature at which the proxy stands: a slide along it follows
        force_ball,  ///< at the edge of the ball that holds the proxy
        limit        ///< out of iterations or work; the motion goes on in the next tick
    };
    /// Features that a slide tries where the proxy stands, one after the other.
    static constexpr int max_features_tried = 12;

    /// What the path meets first up to the parameter `max_t`, the feature `skip` left out. Looks at
    /// a short part from the start, then at four times as much, and so on: most paths end soon.
    /// Where the tick may look no further, `t` without a feature tells how much is free.
    FeatureHit sweep(const ArcPath& path, double max_t, int skip) const noexcept {
        for (double reach = first_part * R_;; reach *= 4) {
            const FeatureHit hit = first_hit(path, std::min(reach, max_t), skip);
            if (hit.feature != none || !(reach < max_t)) return hit;
            if (curve_.budget().is_spent()) return {{.t = reach}};
        }
    }

    /// What the path meets first up to `max_t`, among the boxes that it may pass.
    FeatureHit first_hit(const ArcPath& path, double max_t, int skip) const noexcept {
        FeatureHit hit;
        const auto try_feature = [&](std::uint32_t number) noexcept {
            const int i = static_cast<int>(number);
            const double reach = R_ + std::min(max_t, hit.t) + limits_.start_slack;
            if (i == skip || curve_[i].box.distance2(path.x) > reach * reach) return;
            curve_.budget().spend(steps_a_try);
            const Entry entry = first_entry(curve_[i], path, std::min(max_t, hit.t), limits_);
            if (entry.t < hit.t) hit = {entry, i};
        };
        const auto is_near = [&](const Box<2>& box) noexcept {
            return may_pass(path, std::min(max_t, hit.t), box);
        };
        curve_.budget().spend(curve_.tree().visit(is_near, try_feature));
        return hit;
    }
    /// Whether the path up to `max_t` may come within R of a box. Of a circle it is enough to know
    /// that it gets no further from its start than t.
    bool may_pass(const ArcPath& path, double max_t, const Box<2>& box) const noexcept {
        double from, to;
        if (path.q == 0) return box.clip(path.x, path.T, max_t, R_, from, to);
        const double reach = R_ + max_t;
        return box.distance2(path.x) <= reach * reach;
    }

    /// Moves freely until something is met, then along it, and so on: each turn of the loop is an
    /// iteration. `ball` is null except after a start inside, when the proxy may not leave it.
    Outcome move_freely_and_slide(Vec2& proxy, const Vec2& hip, const ForceBall<2>* ball) noexcept {
        for (int i = 0; i < max_iterations; ++i) {
            if (i > 0 && curve_.budget().is_spent()) break;
            const Vec2 to_hip = hip - proxy;
            const double length = norm(to_hip);
            if (!(length > 0)) return Outcome::rests;
            Outcome outcome = Outcome::blocked;
            if (!is_held(proxy, to_hip)) outcome = move_freely(proxy, hip, to_hip, length, ball);
            if (outcome == Outcome::blocked) outcome = slide(proxy, hip, ball);
            if (outcome != Outcome::goes_on) return outcome;
        }
        return Outcome::limit;
    }

    /// Whether the feature that the proxy slid along last lies between it and the HIP, so that it
    /// need not first try to move freely.
    bool is_held(const Vec2& proxy, const Vec2& to_hip) const noexcept {
        if (current_ == none || !curve_[current_].faces(proxy, limits_.start_slack)) return false;
        const FeatureContact contact = curve_[current_].contact(proxy);
        const bool touches = contact.distance < R_ + limits_.start_slack;
        const double rounding = tuned::pressing_share * (R_ + norm(to_hip));
        return touches && dot(contact.normal, to_hip) < -rounding;
    }

    /// Straight to the HIP, up to the first feature in the way, which becomes the current one; the
    /// feature `skip` is in no way. (E5)
    Outcome move_freely(Vec2& proxy, const Vec2& hip, const Vec2& to_hip, double length,
                        const ForceBall<2>* ball, int skip = none) noexcept {
        const ArcPath path(proxy, (1 / length) * to_hip, 0);
        const FeatureHit hit = sweep(path, length, skip);
        if (ball) {
            const double t = exit_from(*ball, path);
            if (t < std::min(hit.t, length)) {
                proxy = path.at(t);
                current_ = none;
                return Outcome::force_ball;
            }
        }
        current_ = hit.feature;
        if (hit.feature == none && hit.t == infinity) {
            proxy = hip;
            return Outcome::rests;
        }
        if (hit.is_immediate(limits_)) return Outcome::blocked;
        proxy = path.at(hit.t);
        return Outcome::goes_on;
    }

    /// Where a path along a feature ends.
    struct PathEnd {
        double t;         ///< its parameter there [m]
        Outcome outcome;  ///< of a slide that goes as far
        int next;         ///< the feature that the proxy touches there
    };

    /// Along the current feature, or another one that touches the proxy too. What lies R from a
    /// line is a line, and from an arc or a joint it is a circle (E1). So the proxy's path has one
    /// curvature, and it ends at the first of six places. Four are roots of quadratics: nearest to
    /// the HIP (E2), in sight of the HIP (E3), at the end of the feature (E4), and where the path
    /// meets another feature (E5). The fifth is a quarter of the circle, because t grows without
    /// bound towards half of it. The sixth is the edge of the ball, where one holds the proxy.
    Outcome slide(Vec2& proxy, const Vec2& hip, const ForceBall<2>* ball) noexcept {
        lift_to_R(proxy);
        const Vec2 to_hip = hip - proxy;
        HoldingFeatures holding;
        holding.add(*this, current_, proxy);
        Vec2 last_tangent;  // of the feature whose end the proxy stands at; 0 where at none
        for (int tried = 0; tried < max_features_tried; ++tried) {
            if (tried > 0 && curve_.budget().is_spent()) return Outcome::limit;
            curve_.budget().spend(steps_a_slide);
            // Along which of them does a path lead towards the HIP and into none of the others?
            const int i = holding.open_towards(to_hip);
            if (i == none) return holding.count > 1 ? Outcome::corner : Outcome::rests;
            const int feature = holding.feature[i];
            const FeatureContact& contact = holding.contact[i];
            const Vec2 tangent = tangent_towards(contact.normal, to_hip);
            // The feature beyond an end leads back: along neither of the two does the proxy come
            // nearer to the HIP.
            if (dot(tangent, last_tangent) < 0) return Outcome::rests;
            const ArcPath path = offset_path(proxy, tangent, contact);  // (E1)

            // Where the path ends if it meets no other feature. (E2)-(E4)
            PathEnd end = end_of_path(path, to_hip, contact, feature);
            if (end.next != feature && end.t < limits_.start_slack) {
                // The proxy stands at the end of this feature already: the one beyond takes its
                // place, and is tried. A hollow that the proxy fills is added as its two ends.
                const FeatureContact next = curve_[end.next].contact(proxy);
                if (is_full_hollow(next, limits_)) {
                    if (!holding.add(*this, end.next, proxy)) return Outcome::corner;
                    last_tangent = {};
                } else {
                    last_tangent = tangent;
                    holding.feature[i] = end.next;
                    holding.contact[i] = next;
                }
                continue;
            }

            // The HIP is in sight already, along the tangent, though roundings have it that the
            // feature is in the way.
            if (contact.curvature > 0 && end.next == feature && end.t < limits_.start_slack &&
                is_tangent(contact, to_hip)) {
                const Outcome left = move_freely(proxy, hip, to_hip, norm(to_hip), ball, feature);
                if (left != Outcome::blocked) return left;
                if (!holding.add(*this, current_, proxy)) return Outcome::corner;
                last_tangent = {};
                continue;
            }

            // Whether the path meets another feature before that. One that blocks it at its start
            // holds the proxy as well, and another feature is tried. (E5)
            const FeatureHit hit = sweep(path, end.t, feature);
            if (hit.feature != none && hit.is_immediate(limits_)) {
                if (!holding.add(*this, hit.feature, proxy)) return Outcome::corner;
                last_tangent = {};
                continue;
            }
            if (hit.feature != none)
                end = {hit.t, Outcome::goes_on, hit.feature};
            else if (hit.t < end.t)
                end = {hit.t, Outcome::goes_on, feature};
            if (ball) {
                const double t = exit_from(*ball, path);
                if (t < end.t) end = {t, Outcome::force_ball, feature};
            }

            // Only a step that comes nearer to the HIP is taken. (E6)
            const Vec2 next = path.at(end.t);
            if (!(norm(hip - next) < norm(to_hip))) return Outcome::rests;
            proxy = next;
            current_ = end.next;
            return is_wedged(feature, hit, proxy, hip) ? Outcome::corner : end.outcome;
        }
        // So many features were tried and none let the proxy move.
        return Outcome::rests;
    }

    /// Whether a straight way to the HIP sinks by no more than the start slack into what
    /// holds the proxy here.
    bool is_tangent(const FeatureContact& contact, const Vec2& to_hip) const noexcept {
        const double sine = dot(contact.normal, to_hip) / norm(to_hip);
        return sine >= 0 || sine * sine < 2 * contact.curvature * limits_.start_slack;
    }

    /// Where a path along a feature ends if it meets no other one.
    PathEnd end_of_path(const ArcPath& path, const Vec2& to_hip, const FeatureContact& contact,
                        int feature) const noexcept {
        PathEnd end{path.nearest(to_hip), Outcome::rests, feature};  // (E2)
        const auto end_sooner = [&](double t, int next) noexcept {
            if (t < end.t) end = {t, Outcome::goes_on, next};
        };
        // Round a bulge the HIP may be hidden by the bulge, and come into sight. (E3)
        if (contact.curvature > 0) end_sooner(path.in_sight(to_hip, contact.normal), feature);
        end_sooner(path.quarter(), feature);
        for (const EndNormal& feature_end : curve_[feature].ends)
            end_sooner(feature_end.passed_at(path), feature_end.next);  // (E4)
        return end;
    }

    /// Whether the proxy is wedged in a slight hollow kink. It has come there along `feature`, by a
    /// path that touched the other feature of the kink from its start and sank into that slowly. In
    /// the kink each of the two holds the proxy from sliding along the other one. In a gate as wide
    /// as the proxy the two features face each other and have opposed normals. That is no wedge:
    /// the proxy gets through by sinking a little.
    bool is_wedged(int feature, const FeatureHit& hit, const Vec2& proxy,
                   const Vec2& hip) const noexcept {
        if (!hit.is_touching || current_ != hit.feature) return false;
        HoldingFeatures both;
        return both.add(*this, feature, proxy) && both.add(*this, current_, proxy) &&
               dot(both.contact[0].normal, both.contact[1].normal) > 0 &&
               both.open_towards(hip - proxy) == none;
    }

    /// Lifts the proxy back to R from the current feature where roundings have let it sink by half
    /// of the band.
    void lift_to_R(Vec2& proxy) noexcept {
        const FeatureContact contact = curve_[current_].contact(proxy);
        const double up = R_ - contact.distance;
        if (up < band_ / 2) return;
        const ArcPath path(proxy, contact.normal, 0);
        const FeatureHit hit = sweep(path, up, current_);
        if (!hit.is_immediate(limits_)) proxy = path.at(std::min(hit.t, up));
    }

    /// Where the path comes out of the ball, which holds its start.
    static double exit_from(const ForceBall<2>& ball, const ArcPath& path) noexcept {
        const Vec2 w = path.x - ball.middle;
        const double inside = std::min((dot(w, w) - ball.radius * ball.radius) / 2, 0.0);
        return (-path.quadratic_along(inside, w, 1)).first_descent();
    }

    Curve curve_;
    RoundingLimits limits_;
    double R_, band_, neighbourhood_;
    int current_ = none;                // the feature that the proxy has met or slid along last
    Outcome outcome_ = Outcome::rests;  // of the last motion
    double distance_ = infinity;        // from the curve, where the proxy was checked last [m]
};

/// The rule `exact` on lines and arcs: its motion, and around it the guarantees of GuardedRule.
using CurveRule = GuardedRule<CurveMotion>;

}  // namespace vfplan::inline v1::curve
