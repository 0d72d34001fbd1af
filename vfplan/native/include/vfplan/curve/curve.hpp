// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A curve of lines and arcs in the plane, and what of it lies near: its features in drawing order
// under a tree of boxes.
#pragma once

#include <cstdint>

#include "vfplan/curve/feature.hpp"
#include "vfplan/curve/stroke.hpp"

namespace vfplan::curve {

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

}  // namespace vfplan::curve
