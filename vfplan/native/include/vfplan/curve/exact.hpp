// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Rule `exact`: the proxy among lines and arcs, not among samples of them.
//
// The positions R away from a line or an arc are again lines and arcs, so that the proxy is a point
// among them. Inside of that, it is led out first.
#pragma once

#include <cstdint>
#include <utility>

#include "vfplan/curve/offset.hpp"
#include "vfplan/curve/pieces.hpp"
#include "vfplan/parameters.hpp"
#include "vfplan/rules/start_inside.hpp"

namespace vfplan::curve {

// A curve of lines and arcs in the plane, and what of it lies near: its features in drawing order
// under a tree of boxes.

/// A line or an arc of at most a quarter circle, from a to b.
struct Piece {
    Vec2 a, b, begins, ends;  ///< vertices, and unit tangents there
    double kappa = 0;         ///< curvature [1/m], positive to the left

    Piece(const Vec2& from, const Vec2& to, double bulge) noexcept : a(from), b(to) {
        const double chord = norm(b - a), share = 1 / (1 + bulge * bulge);
        const Vec2 e = (1 / chord) * (b - a);
        const double c = (1 - bulge * bulge) * share, s = 2 * bulge * share;
        begins = c * e - s * left(e);
        ends = c * e + s * left(e);
        kappa = 2 * s / chord;
    }
};

class Curve {
  public:
    Curve() = default;

    /// `across`: the plane's two coordinates of a point in space. R [m]: of the proxy that is to
    /// go round it, which comes no nearer than `level`.
    template <class Slice>
    Curve(const std::vector<Stroke>& strokes, const Slice& space, double level) : level_(level) {
        for (const Stroke& s : strokes) {
            std::vector<Vec2> corners(s.bulges.size());
            for (std::size_t i = 0; i < corners.size(); ++i) {
                const double* v = s.vertices.data() + 3 * i;
                corners[i] = space.across({{v[0], v[1], v[2]}});
            }
            add(corners, s);
        }
        features_.shrink_to_fit();
        plant(0, static_cast<std::uint32_t>(features_.size()));
        nodes_.shrink_to_fit();
    }

    const Feature& operator[](int i) const noexcept {
        return features_[static_cast<std::size_t>(i)];
    }
    std::size_t size() const noexcept { return features_.size(); }
    std::size_t boxes() const noexcept { return nodes_.size(); }
    std::size_t bytes() const noexcept {
        return features_.capacity() * sizeof(Feature) + nodes_.capacity() * sizeof(Node);
    }

    /// Calls f(i) for every feature whose box meets what `near(least, most)` says of boxes, and for
    /// some more.
    template <class Near, class F>
    void visit(Near&& near, F&& f) const noexcept {
        for (std::uint32_t k = 0; k < nodes_.size();) {
            const Node& node = nodes_[k];
            if (!near(node.least, node.most)) {
                k = node.skip;
                continue;
            }
            for (std::uint32_t i = node.first; i < node.last; ++i) f(static_cast<int>(i));
            ++k;
        }
    }
    /// ... for every feature within `reach` of y.
    template <class F>
    void around(const Vec2& y, double reach, F&& f) const noexcept {
        visit(
            [&](const Vec2& least, const Vec2& most) noexcept {
                double square = 0;
                for (int k = 0; k < 2; ++k) {
                    const double gap = std::max({least.c[k] - y.c[k], y.c[k] - most.c[k], 0.0});
                    square += gap * gap;
                }
                return square <= reach * reach;
            },
            f);
    }

    /// Distance of y from the curve [m].
    double distance(const Vec2& y) const noexcept {
        double least = never;
        visit(
            [&](const Vec2& low, const Vec2& high) noexcept {
                double square = 0;
                for (int k = 0; k < 2; ++k) {
                    const double gap = std::max({low.c[k] - y.c[k], y.c[k] - high.c[k], 0.0});
                    square += gap * gap;
                }
                return square <= least * least;
            },
            [&](int i) noexcept { least = std::min(least, (*this)[i].distance(y)); });
        return least;
    }

  private:
    static constexpr std::uint32_t leaf = 4;                // features under one box
    static constexpr double quarter = 0.41421356237309515;  // tan(pi / 8): a quarter circle's bulge

    struct Node {
        Vec2 least, most;
        std::uint32_t first = 0, last = 0;  // features of a leaf; none of a branch
        std::uint32_t skip = 0;             // the node behind all that hang on this one
    };

    void add(const std::vector<Vec2>& corners, const Stroke& s) {
        std::vector<Piece> pieces;
        const std::size_t n = corners.size();
        for (std::size_t i = 0; i + (s.closed ? 0 : 1) < n; ++i)
            cut(corners[i], corners[(i + 1) % n], s.bulges[i], pieces);
        const int first = static_cast<int>(features_.size());
        if (pieces.empty()) {
            features_.push_back(joint(corners[0]));
            return;
        }
        const int count = static_cast<int>(pieces.size());
        const Piece* piece = pieces.data();
        const int last = first + 2 * count - (s.closed ? 1 : 0);
        for (int i = 0; i < count; ++i) {
            const Piece* before = i > 0 ? &piece[i - 1] : s.closed ? &piece[count - 1] : nullptr;
            const int at = first + 2 * i;
            features_.push_back(joint(piece[i].a));
            const int back = before ? (i > 0 ? at - 1 : last) : -1;
            bound(features_.back(), before, back, &piece[i], at + 1);
            features_.push_back(side(piece[i], at, i + 1 < count || !s.closed ? at + 2 : first));
        }
        if (s.closed) return;
        features_.push_back(joint(pieces.back().b));
        bound(features_.back(), &pieces.back(), last - 1, nullptr, -1);
    }

    /// Halves an arc until it is a quarter circle at most; a piece of no length is none.
    static void cut(const Vec2& a, const Vec2& b, double bulge, std::vector<Piece>& pieces) {
        if (a == b) return;
        if (std::abs(bulge) <= quarter) {
            pieces.emplace_back(a, b, bulge);
            return;
        }
        const Vec2 middle = 0.5 * (a + b) - (bulge / 2) * left(b - a);
        const double half = bulge / (1 + std::sqrt(1 + bulge * bulge));
        cut(a, middle, half, pieces);
        cut(middle, b, half, pieces);
    }

    Feature joint(const Vec2& at) const noexcept {
        Feature f;
        f.base = f.least = f.most = at;
        f.kappa = 1;
        f.high = level_ * level_ / 2;
        f.high_slope = level_;
        for (Border& border : f.border) border.at = at;
        return f;
    }
    /// What lies around the joint f alone: behind the end of one piece, before the other begins.
    static void bound(Feature& f, const Piece* in, int before, const Piece* out,
                      int behind) noexcept {
        if (in) f.border[0] = {f.base, -1.0 * in->ends, before};
        if (out) f.border[1] = {f.base, out->begins, behind};
    }
    Feature side(const Piece& p, int before, int behind) const noexcept {
        Feature f;
        f.base = p.a;
        f.kappa = std::abs(p.kappa);
        f.n = (p.kappa < 0 ? -1.0 : 1.0) * left(p.begins);
        f.high = level_ + f.kappa * level_ * level_ / 2;
        f.high_slope = 1 + f.kappa * level_;
        if (f.kappa * level_ < 1) {
            f.low = -level_ + f.kappa * level_ * level_ / 2;
            f.low_slope = 1 - f.kappa * level_;
        }
        f.border[0] = {p.a, -1.0 * p.begins, before};
        f.border[1] = {p.b, p.ends, behind};
        // The arc lies in the triangle of its chord and the tangents at its ends.
        const double chord = norm(p.b - p.a);
        const double c = dot(p.begins, (1 / chord) * (p.b - p.a));
        const Vec2 tip = p.a + (chord / (2 * c)) * p.begins;
        for (int k = 0; k < 2; ++k) {
            f.least.c[k] = std::min({p.a.c[k], p.b.c[k], tip.c[k]});
            f.most.c[k] = std::max({p.a.c[k], p.b.c[k], tip.c[k]});
        }
        return f;
    }

    void plant(std::uint32_t first, std::uint32_t last) {
        const std::size_t at = nodes_.size();
        Node node;
        node.least = {{never, never}};
        node.most = {{-never, -never}};
        for (std::uint32_t i = first; i < last; ++i)
            for (int k = 0; k < 2; ++k) {
                node.least.c[k] = std::min(node.least.c[k], features_[i].least.c[k]);
                node.most.c[k] = std::max(node.most.c[k], features_[i].most.c[k]);
            }
        nodes_.push_back(node);
        if (last - first <= leaf) {
            nodes_[at].first = first;
            nodes_[at].last = last;
        } else {
            const std::uint32_t half = first + (last - first) / 2;
            plant(first, half);
            plant(half, last);
        }
        nodes_[at].skip = static_cast<std::uint32_t>(nodes_.size());
    }

    double level_ = 0;
    std::vector<Feature> features_;
    std::vector<Node> nodes_;
};

// What of the curve lies near the proxy, and what of it a way meets first: of a list of features
// that serves as long as the proxy stays about where it was gathered.

inline constexpr int none = -1;  ///< of a curve's features

/// Where a way first goes lower than a feature allows.
struct Hit {
    double t = never;
    int feature = none;
    bool touching = false;  ///< it began at that height

    bool at_once(const Heights& h) const noexcept { return t < (touching ? 1e4 : 1.0) * h.slack; }
};

class Nearby {
  public:
    static constexpr double skin = 0.2;  // of R: how far the proxy may go with one gathered list

    Nearby(Curve around, double radius, double band)
        : curve_(std::move(around)),
          heights_{1e-3 * band, 0.75 * band, 0.1 * band},
          R_(radius),
          band_(band) {
        list_.reserve(curve_.size());
    }

    const Curve& curve() const noexcept { return curve_; }
    const Heights& heights() const noexcept { return heights_; }
    void forget() noexcept { gathered_ = false; }
    std::size_t bytes() const noexcept { return list_.capacity() * sizeof list_[0]; }

    /// What the way meets first, within `most`; `skip` is none of it. Looked at from near to far.
    Hit sweep(const Way& path, double most, int skip) noexcept {
        for (double reach = skin * R_ / 2;; reach *= 4) {
            const Hit hit = within(path, std::min(reach, most), skip);
            if (hit.feature != none || !(reach < most)) return hit;
        }
    }

    /// Distance from the curve where that is less than about R, else some more [m].
    double distance(const Vec2& x) noexcept {
        gather(x, 0);
        double least = never;
        for (int i : list_) least = std::min(least, curve_[i].distance(x));
        return least;
    }

  private:
    Hit within(const Way& path, double most, int skip) noexcept {
        Hit hit;
        const auto look = [&](int i) noexcept {
            const double reach = R_ + std::min(most, hit.t) + heights_.slack;
            if (i == skip || curve_[i].box_square(path.x) > reach * reach) return;
            bool touching;
            const double t = meets(curve_[i], path, std::min(most, hit.t), heights_, touching);
            if (t < hit.t) hit = {t, i, touching};
        };
        if (gather(path.x, most)) {
            for (int i : list_) look(i);
        } else {
            curve_.visit(
                [&](const Vec2& least, const Vec2& high) noexcept {
                    return passes(path, std::min(most, hit.t), least, high);
                },
                look);
        }
        return hit;
    }
    /// Whether the way up to `most` may come within R of a box.
    bool passes(const Way& path, double most, const Vec2& least, const Vec2& high) const noexcept {
        double from = 0, to = most;
        for (int k = 0; k < 2; ++k) {
            const double low = least.c[k] - R_ - path.x.c[k], top = high.c[k] + R_ - path.x.c[k];
            if (path.q != 0 || path.T.c[k] == 0) {
                const double reach = path.q != 0 ? most : 0;
                if (low > reach || top < -reach) return false;
            } else {
                const double a = low / path.T.c[k], b = top / path.T.c[k];
                from = std::max(from, std::min(a, b));
                to = std::min(to, std::max(a, b));
            }
        }
        return from <= to;
    }

    /// The list of what lies near serves a way of length `most` from x; gathered anew if it has to.
    bool gather(const Vec2& x, double most) noexcept {
        if (gathered_ && norm(x - centre_) + most <= skin * R_) return true;
        if (!(most <= skin * R_ / 2)) return false;
        list_.clear();
        centre_ = x;
        gathered_ = true;
        curve_.around(x, R_ * (1 + skin) + 2 * band_, [&](int i) noexcept { list_.push_back(i); });
        return true;
    }

    Curve curve_;
    Heights heights_;
    double R_, band_;
    std::vector<int> list_;  // features near centre_
    Vec2 centre_;
    bool gathered_ = false;
};

// What holds a proxy at rest: the features that touch it, and which of them it may slide along.

/// Tangent of a wall towards u.
inline Vec2 ahead(const Vec2& normal, const Vec2& u) noexcept {
    const Vec2 T = left(normal);
    return dot(T, u) < 0 ? -1.0 * T : T;
}

/// A hollow that the proxy fills: it is pushed from all its directions at once.
inline bool full(const Contact& c, const Heights& h) noexcept { return -c.bend * h.filled > 1; }

struct Walls {
    static constexpr int most = 6;  // that are looked at together

    int feature[most], count = 0;
    Contact touch[most];

    /// False where it is there already, or there are too many. A full hollow pushes as much as its
    /// two ends do.
    bool add(const Nearby& near, int what, const Vec2& x) noexcept {
        for (int j = 0; j < count; ++j)
            if (feature[j] == what) return false;
        const Contact c = near.curve()[what].contact(x);
        if (full(c, near.heights())) {
            const Border* ends = near.curve()[what].border;
            const bool one = add(near, ends[0].next, x), other = add(near, ends[1].next, x);
            return one || other;
        }
        if (count == most) return false;
        feature[count] = what;
        touch[count++] = c;
        return true;
    }
    /// The wall along which a step leads nearer to u and into no other; the last met first.
    int free(const Vec2& u) const noexcept {
        for (int i = count - 1; i >= 0; --i) {
            const Vec2 T = ahead(touch[i].normal, u);
            bool open = dot(T, u) > 0;
            for (int j = 0; j < count && open; ++j)
                open = j == i || dot(T, touch[j].normal) > -1e-9;
            if (open) return i;
        }
        return none;
    }
};

// A proxy on its way to the HIP: straight until it meets the curve, and then along it, until it is
// nearest to the HIP, sees it, comes to the end of the piece, or meets another one. Each of these
// ends is a root of a quadratic, and each iteration brings it nearer to the HIP.

enum class End { arrived, rest, corner, more, blocked, leash, limit };

class Slider {
  public:
    static constexpr int most_iterations = 32;

    Slider(Curve curve, double radius, double band)
        : near_(std::move(curve), radius, band), R_(radius), band_(band) {}

    Nearby& near() noexcept { return near_; }
    const Nearby& near() const noexcept { return near_; }
    const Curve& curve() const noexcept { return near_.curve(); }

    void let_go() noexcept { on_ = none; }
    bool held() const noexcept { return on_ != none; }
    /// From what the proxy slid along last.
    Vec2 normal(const Vec2& x) const noexcept { return curve()[on_].contact(x).normal; }

    /// From x towards the HIP at h, as far as the leash allows.
    End go(Vec2& x, const Vec2& h, const Leash<2>* leash) noexcept {
        for (int i = 0; i < most_iterations; ++i) {
            const Vec2 u = h - x;
            const double length = norm(u);
            if (!(length > 0)) return End::arrived;
            End end = presses(x, u) ? End::blocked : fly(x, h, u, length, leash);
            if (end == End::blocked) end = slide(x, h, leash);
            if (end != End::more) return end;
        }
        return End::limit;
    }

  private:
    static constexpr int turns = 12;  // from feature to feature where the proxy stands

    /// Whether the feature that the proxy slid along last holds it from going along u.
    bool presses(const Vec2& x, const Vec2& u) const noexcept {
        const double slack = near_.heights().slack;
        if (on_ == none || !curve()[on_].beside(x, slack)) return false;
        const Contact c = curve()[on_].contact(x);
        return c.distance < R_ + slack && dot(c.normal, u) < -1e-12 * (R_ + norm(u));
    }

    /// Straight to the HIP, up to what lies on the way.
    End fly(Vec2& x, const Vec2& h, const Vec2& u, double length, const Leash<2>* leash) noexcept {
        const Way path(x, (1 / length) * u, 0);
        const Hit hit = near_.sweep(path, length, none);
        const double most = std::min(hit.t, length);
        if (leash)
            if (const double t = leaves(*leash, path); t < most) {
                x = path.at(t);
                on_ = none;
                return End::leash;
            }
        on_ = hit.feature;
        if (hit.feature == none) {
            x = h;
            return End::arrived;
        }
        if (hit.at_once(near_.heights())) return End::blocked;
        x = path.at(hit.t);
        return End::more;
    }

    /// Along what holds the proxy; `rest` and `corner` where that leads no nearer to the HIP.
    End slide(Vec2& x, const Vec2& h, const Leash<2>* leash) noexcept {
        raise(x);
        const Vec2 u = h - x;
        Walls w;
        w.add(near_, on_, x);
        Vec2 before;
        for (int turn = 0; turn < turns; ++turn) {
            const int i = w.free(u);
            if (i == none) return w.count > 1 ? End::corner : End::rest;
            const Contact& c = w.touch[i];
            const Vec2 T = ahead(c.normal, u);
            if (dot(T, before) < 0) return End::rest;  // a kink, from both sides of it
            Way path(x, T, 0);
            path.q = (dot(path.N, c.normal) < 0 ? c.bend : -c.bend) / 2;
            Stop stop = along(path, u, c, w.feature[i]);
            if (stop.next != w.feature[i] &&
                stop.t < near_.heights().slack) {  // at its end already
                const Contact on = curve()[stop.next].contact(x);
                if (full(on, near_.heights())) {
                    if (!w.add(near_, stop.next, x)) return End::corner;
                    before = {};
                    continue;
                }
                before = T;
                w.feature[i] = stop.next;
                w.touch[i] = on;
                continue;
            }
            const Hit hit = near_.sweep(path, stop.t, w.feature[i]);
            if (hit.feature != none && hit.at_once(near_.heights())) {
                if (!w.add(near_, hit.feature, x)) return End::corner;
                before = {};
                continue;
            }
            if (hit.feature != none) stop = {hit.t, End::more, hit.feature};
            if (leash)
                if (const double s = leaves(*leash, path); s < stop.t)
                    stop = {s, End::leash, w.feature[i]};
            const Vec2 y = path.at(stop.t);
            if (!(norm(h - y) < norm(u))) return End::rest;
            x = y;
            on_ = stop.next;
            return wedged(w.feature[i], hit, x, h) ? End::corner : stop.end;
        }
        return End::rest;
    }

    /// In a slight hollow kink, between a feature and one that the way along it had sunk into: each
    /// holds from sliding on the other. In a gate, sinking a little gets the proxy through.
    bool wedged(int feature, const Hit& hit, const Vec2& x, const Vec2& h) const noexcept {
        if (!hit.touching || on_ != hit.feature) return false;
        Walls both;
        return both.add(near_, feature, x) && both.add(near_, on_, x) &&
               dot(both.touch[0].normal, both.touch[1].normal) > 0 && both.free(h - x) == none;
    }

    /// Where a way along a feature ends, nothing else met, and on what it goes on.
    struct Stop {
        double t;
        End end;
        int next;
    };
    Stop along(const Way& path, const Vec2& u, const Contact& c, int feature) const noexcept {
        Stop stop{path.nearest(u), End::rest, feature};
        const auto sooner = [&](double t, int next) noexcept {
            if (t < stop.t) stop = {t, End::more, next};
        };
        if (c.bend > 0) sooner(path.in_sight(u, c.normal), feature);
        sooner(path.quarter(), feature);
        for (const Border& b : curve()[feature].border) sooner(b.met(path), b.next);
        return stop;
    }

    /// Up to R again where roundings have let the proxy sink.
    void raise(Vec2& x) noexcept {
        const Contact c = curve()[on_].contact(x);
        const double up = R_ - c.distance;
        if (up < band_ / 2) return;
        const Way path(x, c.normal, 0);
        const Hit hit = near_.sweep(path, up, on_);
        if (!hit.at_once(near_.heights())) x = path.at(std::min(hit.t, up));
    }
    /// Where the way comes out of the leash's ball.
    static double leaves(const Leash<2>& leash, const Way& path) noexcept {
        const Vec2 w = path.x - leash.middle;
        const double in = std::min((dot(w, w) - leash.radius * leash.radius) / 2, 0.0);
        return (-path.along(in, w, 1)).falls();
    }

    Nearby near_;
    double R_, band_;
    int on_ = none;  // what the proxy slid along last
};

/// What a start may be inside of: all that lies nearer to the curve than R.
class Bands {
  public:
    explicit Bands(double radius) noexcept : R_(radius) {}

    Vec2 from_nearest(const Curve& curve, const Vec2& x) const noexcept {
        double least = R_ * (1 + 1e-6);
        Vec2 away;
        curve.around(x, least, [&](int i) noexcept {
            const double d = curve[i].distance(x);
            if (d < least && d > 0) least = d, away = curve[i].contact(x).normal;
        });
        return away;
    }
    double out(const Curve& curve, const Vec2& y, const Vec2& d) const noexcept {
        const Way path(y, d, 0);
        double s = -never;
        curve.around(y, R_, [&](int i) noexcept {
            if (curve[i].distance(y) < R_ * (1 - 1e-9)) s = std::max(s, curve[i].out(path));
        });
        return s;
    }

  private:
    double R_;
};

class ExactRule {
  public:
    static constexpr int dimension = 2;
    /// Of R: how far below R roundings may let the proxy sink.
    static constexpr double finest = 1e-7;
    static constexpr int most_iterations = Slider::most_iterations;
    static constexpr double list_reach = 1 + Nearby::skin + 4 * finest;  // of R

    /// What roundings take [m], where the strokes lie far from the origin too.
    static double band(const Parameters& p, const std::vector<Stroke>& strokes) noexcept {
        double most = 0;
        for (const Stroke& s : strokes)
            for (double c : s.vertices) most = std::max(most, std::abs(c));
        const double rounding = std::numeric_limits<double>::epsilon() * most;
        return std::max(finest * p.R(), roundings_a_band * rounding);
    }

    ExactRule(Curve curve, const Parameters& p)
        : R_(p.R()),
          band_(p.band),
          outer_(p.outer_radius + p.point_radius),
          slider_(std::move(curve), R_, band_),
          entrance_(Bands(R_), R_) {}

    void reset() noexcept {
        entrance_.reset();
        rests_ = false;
        slider_.near().forget();
        slider_.let_go();
    }
    /// As a reset, but a proxy that is inside is led out from where it is.
    void go_on(const Passage<2>* before) noexcept {
        reset();
        entrance_.go_on(before);
    }
    std::size_t bytes() const noexcept { return curve().bytes() + slider_.near().bytes(); }
    std::size_t cells() const noexcept { return curve().boxes(); }
    double distance(const Vec2& x) const noexcept { return curve().distance(x); }

    /// One servo loop.
    Tick<2> operator()(Vec2& proxy, const Vec2& hip) noexcept {
        const auto clear = [&]() noexcept { return curve().distance(proxy) >= R_ - band_; };
        if (!entrance_.outside(curve(), proxy, hip, clear)) {
            slider_.let_go();
            rests_ = false;
            return entrance_.tick();
        }
        if (rests_ && hip == hip_) return last_;
        hip_ = hip;
        const Vec2 start = proxy;
        Tick<2> tick;
        if (entrance_.taking_over()) {
            const Leash<2> leash = entrance_.leash(proxy, hip);
            end_ = slider_.go(proxy, hip, &leash);
            if (entrance_.goes_on(end_ == End::leash, end_ == End::limit)) tick.status = inside;
        } else {
            end_ = slider_.go(proxy, hip, nullptr);
        }
        if (end_ == End::limit) tick.status |= limit;
        double near = slider_.near().distance(proxy);
        if (!(near >= R_ - band_)) {  // cannot happen; if it does, stay where it was safe
            proxy = start;
            slider_.let_go();
            near = slider_.near().distance(proxy);
            tick.status |= limit;
            entrance_.hold(near >= R_ - band_);
        }
        rests_ = tick.status == ok;
        describe(proxy, hip, near, tick);
        return last_ = tick;
    }

  private:
    const Curve& curve() const noexcept { return slider_.curve(); }

    void describe(const Vec2& x, const Vec2& hip, double near, Tick<2>& tick) noexcept {
        if (near <= R_ + band_) {
            tick.state = State::in_contact;
            tick.normal =
                !slider_.held() || end_ == End::corner ? along(x - hip, 1) : slider_.normal(x);
        } else if (std::min(near, outer_) < outer_ || curve().distance(x) < outer_) {
            tick.state = State::free_motion;
        }
    }

    double R_, band_, outer_;
    Slider slider_;
    Entrance<2, const Curve, Bands> entrance_;
    Vec2 hip_;
    End end_ = End::arrived;
    Tick<2> last_;
    bool rests_ = false;
};

}  // namespace vfplan::curve
